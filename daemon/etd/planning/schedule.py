"""A plan as a schedule: which pulse is due when, and what a newer frame leaves of a scan.

Owns: the schedule of one plan, electrode by electrode and scan by scan, until its frame expires or
has had its pulses. Must not know: how a pulse is fired, the board, sockets, clocks: time comes in.

A schedule can be run by hand:

    schedule = Schedule(plan, expires_host_ns, now_ns)
    schedule.begin_scan(now_ns)
    while (due := schedule.next_due()) is not None:
        schedule.was_fired(due, now_ns)
        schedule.advance()
    schedule.end_scan(now_ns)
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final, Literal

from etd.planning.plan import Plan
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.errors import Refused
from etd.pulse.request import PulseRequest
from etd.safety.maxima import Maxima

#: Rounding of rates may leave a pulse this little short of due.
_ALMOST = 1e-9
#: A scan that begins this late was held up: waking late does not explain it.
_LATE_NS = 2_000_000
#: A scan longer than this can be changed by a newer frame; a scan in bursts always can.
_LONG_NS = 50_000_000

#: `stimulus`: a pulse of a frame. `contact_poll`: a probe of an electrode that the frame leaves
#: silent. `measurement`: a probe of a power-up, for `arm` or `measure`.
Purpose = Literal["stimulus", "contact_poll", "measurement"]


class AfterProbe:
    """The request for a pulse before its own probe, its time and ceiling; and the current of that
    probe.
    """

    __slots__ = ("asked_ns", "ceiling_ua", "probe_ua", "request")

    def __init__(
        self, request: PulseRequest, probe_ua: int, asked_ns: int, ceiling_ua: int
    ) -> None:
        self.request: Final = request
        self.probe_ua: Final = probe_ua
        self.asked_ns: Final = asked_ns
        self.ceiling_ua: Final = ceiling_ua


class DuePulse:
    """A pulse that is due now.

    `place` is its place in the plan (-1: no pulse of a frame). `rewrites_chain`: the whole chain is
    shifted for it. `after`: its own probe has just been fired, and the electrodes are still
    connected.
    """

    __slots__ = ("after", "place", "purpose", "rewrites_chain", "scheduled")

    def __init__(
        self,
        scheduled: ScheduledPulse,
        purpose: Purpose,
        place: int = -1,
        rewrites_chain: bool = False,
        after: AfterProbe | None = None,
    ) -> None:
        self.scheduled: Final = scheduled
        self.purpose: Final = purpose
        self.place: Final = place
        self.rewrites_chain: Final = rewrites_chain
        self.after: Final = after

    @property
    def electrode(self) -> int:
        return self.scheduled.electrode

    def following(self, after: AfterProbe) -> DuePulse:
        """The same pulse, once its own probe has been fired."""
        return DuePulse(self.scheduled, self.purpose, self.place, self.rewrites_chain, after)


class _ScanSlot:
    """A pulse of the scan under way, by its place; `is_again` after the first of a burst."""

    __slots__ = ("is_again", "place")

    def __init__(self, place: int, is_again: bool) -> None:
        self.place: Final = place
        self.is_again: Final = is_again


class Schedule:
    def __init__(
        self,
        plan: Plan,
        expires_host_ns: int,
        now_ns: int,
        before: Schedule | None = None,
        trigger_ns: int | None = None,
        fired_ns: dict[int, int] | None = None,
    ) -> None:
        """`before`: the schedule that this one replaces, if any; rates continue across both. The
        schedule expires on the machine's clock; all else counts on the board's. `trigger_ns`: the
        edge for which its frame has waited; until then its scans have contact polls only.
        `fired_ns`: of each electrode when the scan was due in which any frame has fired it last;
        it is kept up to date.
        """
        self.plan = plan
        self.expires_host_ns = expires_host_ns
        #: Whether a scan of it has begun.
        self.is_begun = False
        self.trigger_ns: Final = trigger_ns
        self.is_waiting: Final = plan.frame.on_trigger and trigger_ns is None
        #: Edges before then do not count.
        self.waits_since_ns = now_ns
        if before is not None and before.is_waiting and plan.frame.renews == before.plan.frame.seq:
            self.waits_since_ns = before.waits_since_ns
        self._turns: Sequence[_ScanSlot] = ()
        self._polls: Sequence[ScheduledPulse] | None = None
        self._polls_owed = 0
        self._at = 0
        #: Each pulse as a newer frame leaves it for the rest of the scan under way.
        self._left_of: list[ScheduledPulse | None] = list(plan.schedule)
        if fired_ns is None:
            fired_ns = {} if before is None else before._fired_ns
        self._fired_ns: dict[int, int] = fired_ns
        #: When the last scan began, and when it was due.
        self._scanned_ns: int | None = None if before is None else before._scanned_ns
        self._due_ns = now_ns
        self.next_ns = now_ns
        if before is not None and self._scanned_ns is not None:
            due_ns = min(before.next_ns, self._scanned_ns + plan.period_ns)
            self.next_ns = max(now_ns, due_ns)
        self.next_ns = max(self.next_ns, self._levels_rest_until_ns())
        # The fastest electrodes are due in every scan, a slower one in its share of the scans; all
        # are due in the first.
        rates_hz = [scheduled.rate_hz for scheduled in plan.schedule]
        fastest_hz = max(rates_hz, default=1.0)
        self._share = [rate_hz / fastest_hz for rate_hz in rates_hz]
        self._phase = [
            (1.0 if share > 1.0 - _ALMOST else self._rested(scheduled, share)) - share
            for scheduled, share in zip(plan.schedule, self._share, strict=True)
        ]
        pulses = plan.frame.pulses
        self._left = None if pulses is None else [pulses] * len(plan.schedule)
        #: The sum of these.
        self._all_left = (pulses or 0) * len(plan.schedule)
        #: A scan of it has begun, and no pulse of the frame is left.
        self.has_had_its_pulses = False
        #: When the last pulse of each place began.
        self._begun_ns = [now_ns] * len(plan.schedule)

    def _levels_rest_until_ns(self) -> int:
        """Levels were accepted at the rate of their calibration: no sequence of frames, however
        each of them ends, fires one sooner than that after a pulse of any frame.
        """
        levels_hz = self.plan.levels_hz
        if levels_hz is None:
            return 0
        fired = [self._fired_ns.get(scheduled.electrode) for scheduled in self.plan.schedule]
        last_ns = max((each for each in fired if each is not None), default=None)
        return 0 if last_ns is None else last_ns + int(1e9 / levels_hz)

    def _rested(self, scheduled: ScheduledPulse, share: float) -> float:
        """How much of its period an electrode has rested when this frame begins; 1 is all of it.
        Less than half a scan short counts as all of it.
        """
        fired_ns = self._fired_ns.get(scheduled.electrode)
        if fired_ns is None:
            return 1.0
        return min(1.0, (self.next_ns - fired_ns) * scheduled.rate_hz / 1e9 + share / 2)

    # --- the frame ---------------------------------------------------------------------------

    def has_expired(self, host_ns: int) -> bool:
        return host_ns >= self.expires_host_ns

    def lower(self, newer: Plan) -> None:
        """A newer plan follows the scan under way: what it lowers is lowered now."""
        wanted = {scheduled.electrode: scheduled for scheduled in newer.schedule}
        self._left_of = [
            None if visit is None else visit.lowered_to(wanted.get(visit.electrode))
            for visit in self._left_of
        ]

    def fit(self, maxima: Maxima) -> Refused | None:
        """Called between two scans, when the possible widths have changed: stabilizers get no more
        room than there is now. Returns the refusal where a pulse of the frame itself is not
        possible any more.
        """
        for scheduled in self.plan.schedule:
            steps_us = (
                scheduled.width_us,
                scheduled.width_us if scheduled.probe is None else scheduled.probe.width_us,
            )
            is_too_wide = scheduled.width_us + scheduled.bounds.prepulse_us > maxima.width_us
            if is_too_wide or min(steps_us) < maxima.min_width_us:
                return Refused(
                    "over_maximum" if is_too_wide else "board_cannot",
                    f"electrode {scheduled.electrode}: by the last timing calibration pulses here"
                    " have"
                    f" {maxima.min_width_us} to {maxima.width_us} us, so this frame ends: send one"
                    " with another width_us",
                    scheduled.electrode,
                )
        widest_us = maxima.width_us
        schedule = tuple(scheduled.within(widest_us) for scheduled in self.plan.schedule)
        self.plan = dataclasses.replace(self.plan, schedule=schedule)
        self._left_of = [
            None if visit is None else visit.within(widest_us) for visit in self._left_of
        ]
        return None

    # --- one scan ----------------------------------------------------------------------------

    def begin_scan(self, now_ns: int) -> None:
        """The next scan follows a period later; after a stall no scan is made up for."""
        late_ns = now_ns - self.next_ns
        self._due_ns = now_ns if late_ns > _LATE_NS else self.next_ns
        self.next_ns = self._due_ns + self.plan.period_ns
        self._polls, self._at = None, 0
        if self.is_waiting:
            return
        self._scanned_ns = now_ns
        self._turns = self._due_turns()
        self.is_begun = True
        self.has_had_its_pulses = self._left is not None and not self._all_left

    def _due_turns(self) -> list[_ScanSlot]:
        """The pulses of the scan that begins now, burst after burst."""
        plan, wanted = self.plan, self._wanted()
        return [
            _ScanSlot(place, number > 0)
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

    def next_due(self) -> DuePulse | None:
        """The next pulse of the scan under way, its contact polls after the frame's own; None when
        none is left.
        """
        turns = self._turns
        while self._at < len(turns):
            place = turns[self._at].place
            scheduled = self._left_of[place]
            if scheduled is not None:
                return DuePulse(scheduled, "stimulus", place)
            # A newer frame has taken it away from the scan under way.
            self._at += 1
        polls, at = self._polls or (), self._at - len(turns)
        if at < len(polls):
            return DuePulse(polls[at], "contact_poll", rewrites_chain=at == 0)
        return None

    def _pass_over_lowered(self) -> None:
        """Skips pulses that a newer frame has taken away from the scan under way."""
        while self._at < len(self._turns) and self._left_of[self._turns[self._at].place] is None:
            self._at += 1

    def advance(self) -> None:
        """The pulse that `next_due` gave is over, fired or not."""
        self._at += 1

    @property
    def upcoming(self) -> ScheduledPulse | None:
        """The pulse that can be shifted in while the one before rests; None after the frame's last
        pulse.
        """
        if self._at >= len(self._turns):
            return None
        return self.plan.schedule[self._turns[self._at].place]

    @property
    def wants_polls(self) -> bool:
        """All pulses of the frame are over, and its contact polls have not been added yet."""
        return self._at >= len(self._turns) and self._polls is None

    def add_polls(self, polls: Sequence[ScheduledPulse], owed: int) -> None:
        """Contact polls after the frame's own pulses; the first `owed` are made even when time is
        short.
        """
        self._polls, self._polls_owed = polls, owed

    def is_over(self, now_ns: int, poll_ns: int) -> bool:
        """Whether the scan under way is over; a contact poll takes `poll_ns`."""
        at = self._at - len(self._turns)
        if self._polls is None or at < 0:
            return False
        if at >= len(self._polls):
            return True
        return at >= self._polls_owed and now_ns > self.next_ns - poll_ns

    def end_scan(self, now_ns: int) -> bool:
        """Returns True if the scan ended too late for the next one, which then begins now; after a
        stall it begins a period from now, because electrodes may just have been fired.
        """
        late_ns = now_ns - self.next_ns
        if late_ns <= 0:
            return False
        self.next_ns = now_ns + (self.plan.period_ns if late_ns > self.plan.period_ns else 0)
        return True

    def slow_down(self, ratio: float) -> None:
        """This machine takes so many times the period: the next scans are so far apart."""
        plan = self.plan
        period_ns, rate_hz = round(plan.period_ns * ratio), plan.rate_hz / ratio
        self.plan = dataclasses.replace(plan, period_ns=period_ns, rate_hz=rate_hz)

    def was_paused(self, pause_ns: int) -> None:
        """The rest of this scan and the scans after it are `pause_ns` later."""
        self.next_ns += pause_ns

    def is_long(self, now_ns: int) -> bool:
        """Whether a newer frame need not wait for the end of the scan under way."""
        since_ns = now_ns if self._scanned_ns is None else self._scanned_ns
        return self.plan.pulses > 1 or now_ns - since_ns >= _LONG_NS

    def earliest_ns(self) -> int:
        """When the next pulse may begin: in a burst an interval after the one before, else 0."""
        self._pass_over_lowered()
        if self._at >= len(self._turns):
            return 0
        turn = self._turns[self._at]
        return self._begun_ns[turn.place] + self.plan.interval_ns if turn.is_again else 0

    def was_fired(self, due: DuePulse, begun_ns: int) -> None:
        """The stimulus `due` began at `begun_ns`."""
        self._begun_ns[due.place] = begun_ns
        self._fired_ns[due.scheduled.electrode] = self._due_ns
        if self._left is not None:
            self._left[due.place] -= 1
            self._all_left -= 1
            self.has_had_its_pulses = not self._all_left
