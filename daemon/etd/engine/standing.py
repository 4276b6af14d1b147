"""A plan on show: what of it is due when, and what a newer one leaves of the scan under way.

Owns: the schedule of one plan, electrode by electrode, until it expires or has had its pulses.
Must not know: how a visit is made, the board, sockets, clocks: time comes in.
"""

from __future__ import annotations

import msgspec

from etd.engine.plan import Plan
from etd.engine.visit import Visit

#: Rounding of rates may leave a visit this little short of due.
_ALMOST = 1e-9
#: A scan that begins this late has been held up: more than waking late explains.
_LATE_NS = 2_000_000
#: A scan that lasts longer than this is looked into by newer frames; one in bursts at every pulse.
_LONG_NS = 50_000_000


class Turn(msgspec.Struct, frozen=True):
    """One visit of a scan, by its place in the plan; `is_again` after the first of a burst."""

    place: int
    is_again: bool = False


class Standing:
    """A plan on show, until it expires or has had its pulses."""

    def __init__(
        self, plan: Plan, expires_host_ns: int, now_ns: int, before: Standing | None = None
    ) -> None:
        """`before`: the one whose place it takes, if one stands. Rates go on across the two.
        It expires on the machine's clock; all else here counts on the board's.
        """
        self.plan = plan
        self.expires_host_ns = expires_host_ns
        self.is_begun = False
        #: What is left of each visit for the rest of the scan under way.
        self._left_of: list[Visit | None] = list(plan.visits)
        #: When the scan began in which an electrode was last visited, and the last one of all.
        self._fired_ns: dict[int, int] = {} if before is None else before._fired_ns
        self._scanned_ns: int | None = None if before is None else before._scanned_ns
        self.next_ns = now_ns
        if before is not None and self._scanned_ns is not None:
            due_ns = min(before.next_ns, self._scanned_ns + plan.period_ns)
            self.next_ns = max(now_ns, due_ns)
        # The fastest is due in every scan, a slower one in its share of them; all in the first.
        fastest_hz = max((visit.rate_hz for visit in plan.visits), default=1.0)
        self._share = [visit.rate_hz / fastest_hz for visit in plan.visits]
        self._phase = [
            self._rested(visit, share) - share
            for visit, share in zip(plan.visits, self._share, strict=True)
        ]
        pulses = plan.frame.pulses
        self._left = None if pulses is None else [pulses] * len(plan.visits)
        #: When the last pulse of each place began.
        self._begun_ns = [now_ns] * len(plan.visits)

    def _rested(self, visit: Visit, share: float) -> float:
        """How much of its period an electrode has rested when this frame begins; 1 is all of it.
        Less than half a scan short counts as all; the fastest are due in every scan.
        """
        fired_ns = self._fired_ns.get(visit.electrode)
        if fired_ns is None or share > 1.0 - _ALMOST:
            return 1.0
        return min(1.0, (self.next_ns - fired_ns) * visit.rate_hz / 1e9 + share / 2)

    def begin_scan(self, now_ns: int) -> None:
        """The next one follows a period later; after a stall nothing is made up for."""
        late_ns = now_ns - self.next_ns
        self._scanned_ns = now_ns
        self.next_ns = (now_ns if late_ns > _LATE_NS else self.next_ns) + self.plan.period_ns

    def was_paused(self, pause_ns: int) -> None:
        """What is still to come of this scan is later by so much, and so are the next ones."""
        self.next_ns += pause_ns

    def end_scan(self, now_ns: int) -> bool:
        """True if it came to its end too late for the next one, which then begins now; but a
        period from now after a stall, because electrodes may just have been visited.
        """
        late_ns = now_ns - self.next_ns
        if late_ns <= 0:
            return False
        self.next_ns = now_ns + (self.plan.period_ns if late_ns > self.plan.period_ns else 0)
        return True

    def has_expired(self, host_ns: int) -> bool:
        return host_ns >= self.expires_host_ns

    @property
    def has_had_its_pulses(self) -> bool:
        return self.is_begun and self._left is not None and not any(self._left)

    def due(self) -> list[Turn]:
        """The visits of the scan that begins now, burst after burst."""
        plan, wanted = self.plan, self._wanted()
        return [
            Turn(place, number > 0)
            for group in plan.groups
            for number in range(plan.pulses)
            for place in group
            if number < wanted[place]
        ]

    def _wanted(self) -> list[int]:
        """How many pulses each place gets in the scan that begins now."""
        found = []
        for place, share in enumerate(self._share):
            self._phase[place] += share
            is_due = self._phase[place] >= 1.0 - _ALMOST
            self._phase[place] -= is_due
            left = self.plan.pulses if self._left is None else self._left[place]
            found.append(min(left, self.plan.pulses) if is_due else 0)
        return found

    def lower(self, newer: Plan) -> None:
        """Another plan comes after the scan under way: what falls by it falls now."""
        wanted = {visit.electrode: visit for visit in newer.visits}
        self._left_of = [
            None if one is None else one.lowered_to(wanted.get(one.electrode))
            for one in self._left_of
        ]

    def visit_of(self, turn: Turn) -> Visit | None:
        """None: a newer frame wants none there."""
        return self._left_of[turn.place]

    def is_long(self, now_ns: int) -> bool:
        """Whether a newer frame is not to wait for the end of the scan under way."""
        since_ns = now_ns if self._scanned_ns is None else self._scanned_ns
        return self.plan.pulses > 1 or now_ns - since_ns >= _LONG_NS

    def earliest_ns(self, turn: Turn) -> int:
        """Within a burst an interval after the pulse before; otherwise at once."""
        return self._begun_ns[turn.place] + self.plan.interval_ns if turn.is_again else 0

    def was_fired(self, place: int, begun_ns: int) -> None:
        self._begun_ns[place] = begun_ns
        if self._scanned_ns is not None:
            self._fired_ns[self.plan.visits[place].electrode] = self._scanned_ns
        if self._left is not None:
            self._left[place] -= 1
