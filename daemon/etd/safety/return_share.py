"""The share of a current that each electrode carries, when all others are the returns of a pulse.

Owns: which electrodes are known to touch, how long a contact poll counts, the least and the most
that each conducts, and the shares that follow. Must not know: caps, ledgers, hardware, clocks: time
comes in.

A current is shared by conductance. A contact that no pulse has measured for a second is unknown.
When one electrode loses contact, no measurement from before counts: what moved it may have moved
others. An unknown electrode adds nothing to what the others conduct. For the ledger it may conduct
as well as the best that was measured since the supply is on; for caps it may carry the whole
current (`return_caps.py`).

The most that an electrode conducts follows from its way back, at the time when most was known of
the others. A path that has fallen since then lowers the own resistance by as much. A path that has
risen changes nothing: the way back may have risen.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from etd.pulse.measured import CONTACT_POLL_NS, MAX_AGE_NS, is_stale
from etd.safety.conductance import PathMeter, Reading, own_bounds
from etd.safety.return_parts import likely_parts, most_parts

#: The shortest time between two readings of a path, and between two updates of what follows from
#: them; the second number holds where an electrode has become known or unknown.
REFRESH_NS, _SOON_NS = 250_000_000, 2_000_000
#: A path that resists less than this part of what was taken over is taken over soon, too: by less
#: the shares are hardly other ones.
_HARDLY_LESS = 0.9
#: What any path resists [design]: where the ADC tells nothing, all are alike. A disk of 5 mm on
#: saline (0.7 ohm m) has 70 ohm, on tissue four times that, one of 1 mm five times either. And
#: what none is read to resist more than.
_LEAST_OHM, _MOST_OHM = 100.0, 1e9
#: How much more than likely the way back is taken to resist, for what it adds to a rise. It is
#: 1 / (1 - x) of all together, which the own part changes little.
_WAY_BACK = 1.25
#: The weight of an electrode that may carry the whole current, whatever the others conduct.
_WHOLE = 1e9
#: An own resistance that is not bounded, and the path when it was found.
_NO_BOUND = (-math.inf, math.inf)


class ReturnShare:
    def __init__(self, electrodes: int, meter: PathMeter) -> None:
        self._electrodes = electrodes
        self._meter = meter
        self.reset()

    def reset(self) -> None:
        """The supply was off: any contact may have changed."""
        count = self._electrodes
        self._touches = [False] * count
        self._looked_ns: list[int | None] = [None] * count
        self._readings: list[Reading | None] = [None] * count
        self._read_ns: list[int | None] = [None] * count
        #: By electrode: the least path that the last refresh had.
        self._taken_ohm = [math.inf] * count
        #: From then on the next pulse of an electrode is to be read.
        self.read_from_ns = [0] * count
        #: The electrodes known to touch, and when each measurement expires.
        self._known: set[int] = set()
        self._ending: deque[tuple[int, int]] = deque()
        #: Whether contact polls are wanted.
        self.is_wanted = False
        #: By electrode, in S: the least that it conducts (0 if unknown), and the most.
        self.least_s = [0.0] * count
        self.most_s = [math.inf] * count
        self._known_s = 0.0
        #: The best that was measured, and the best before a contact was lost.
        self._best_s = self._best_before_s = 0.0
        #: Too few are known, for what bounds them to count.
        self._is_sparse = True
        #: Each was measured or touches nothing; as of the last `refresh`.
        self.are_all_known = False
        #: The least own resistance, and the least path when it was found.
        self._own_ohm = [_NO_BOUND] * count
        self._is_changed = True
        self._refresh_ns = 0

    # --- what is known ---------------------------------------------------------------------------

    def reading(self, electrode: int) -> Reading | None:
        """The last reading of its path, however old."""
        return self._readings[electrode]

    def update(
        self, electrode: int, touches: bool, now_ns: int, reading: Reading | None = None
    ) -> bool:
        """A pulse through all others has measured whether this electrode touches, and its path if
        it was read. Returns whether it hardly conducts better than what follows was found by: if
        not, a refresh is due soon.
        """
        is_better = reading is not None and self._is_better(electrode, reading)
        if reading is not None:
            if is_better:
                self._refresh_soon(now_ns)
            # Between two of its readings a contact changed: this one, or one of its way back.
            before = self._readings[electrode]
            if before is not None and before.differs(reading):
                self._drop_bounds()
                self._refresh_soon(now_ns)
            self._readings[electrode], self._read_ns[electrode] = reading, now_ns
            self.read_from_ns[electrode] = now_ns + REFRESH_NS
            self._is_changed = True
        if not touches:
            self.lose(electrode)
        elif (last := self._readings[electrode]) is None or is_stale(
            self._read_ns[electrode], now_ns
        ):
            self._drop(electrode, now_ns)
        else:
            self._ending.append((now_ns + MAX_AGE_NS, electrode))
            if electrode not in self._known:
                self._add(electrode, last, now_ns)
        self._touches[electrode] = touches
        self._looked_ns[electrode] = now_ns
        return not is_better

    def _is_better(self, electrode: int, reading: Reading) -> bool:
        return reading.least_ohm < _HARDLY_LESS * self._taken_ohm[electrode]

    def lose(self, electrode: int) -> None:
        """This electrode does not touch. If it did before, no contact is known any more."""
        if self._touches[electrode]:
            self._known.clear()
            self._looked_ns[:] = [None] * self._electrodes
            self.least_s[:] = [0.0] * self._electrodes
            self._known_s = 0.0
            self._drop_bounds()
            self._is_changed, self._refresh_ns = True, 0
        self._touches[electrode] = False

    def _drop_bounds(self) -> None:
        """A contact has changed, and what moved it may have changed the others: paths from before
        bound nothing any more. The best of them still stands for those that are unknown.
        """
        self._own_ohm = [_NO_BOUND] * self._electrodes
        self._best_before_s = self._best_s

    def is_known(self, electrode: int, now_ns: int) -> bool:
        """Whether its conductance is known; an open electrode conducts next to nothing."""
        return electrode in self._known or self._is_open(electrode, now_ns)

    def last_touch(self, electrode: int) -> Reading | None:
        """The reading of an electrode that touched when it was measured last; None of others."""
        return self._readings[electrode] if self._touches[electrode] else None

    def _is_open(self, electrode: int, now_ns: int) -> bool:
        return not self._touches[electrode] and not is_stale(self._looked_ns[electrode], now_ns)

    def _add(self, electrode: int, reading: Reading, now_ns: int) -> None:
        """Its own resistance is at most that of its path; the next refresh knows more."""
        least_s = 1.0 / reading.most_ohm
        self._known.add(electrode)
        self.least_s[electrode] = least_s
        self._known_s += least_s
        self._refresh_soon(now_ns)

    def _drop(self, electrode: int, now_ns: int) -> None:
        if electrode in self._known:
            self._known.discard(electrode)
            self._known_s -= self.least_s[electrode]
            self.least_s[electrode] = 0.0
            self._refresh_soon(now_ns)

    def _expire(self, now_ns: int) -> None:
        while self._ending and self._ending[0][0] <= now_ns:
            _, electrode = self._ending.popleft()
            if is_stale(self._looked_ns[electrode], now_ns):
                self._drop(electrode, now_ns)

    def _refresh_soon(self, now_ns: int) -> None:
        self._is_changed, self._refresh_ns = True, min(self._refresh_ns, now_ns + _SOON_NS)

    # --- what follows ----------------------------------------------------------------------------

    def refresh(self, now_ns: int) -> bool:
        """Called before each pulse: updates what follows from the readings when that is due.
        Returns whether it did.
        """
        self._expire(now_ns)
        if not self._is_changed or now_ns < self._refresh_ns:
            return False
        self._is_changed, self._refresh_ns = False, now_ns + REFRESH_NS
        self._find_bounds(now_ns)
        return True

    def _find_bounds(self, now_ns: int) -> None:
        pairs = [
            (electrode, reading)
            for electrode in self._known
            if (reading := self._readings[electrode])
        ]
        beside_s, least_s = 0.0, [0.0] * self._electrodes
        unknown = 0
        for electrode in range(self._electrodes):
            if electrode not in self._known:
                is_open = self._is_open(electrode, now_ns)
                unknown += not is_open
                beside_s += self.most_s[electrode] if is_open else math.inf
        self._is_sparse = len(self._known) < unknown
        self.are_all_known = not unknown
        own = own_bounds(self._meter, [reading for _, reading in pairs], beside_s)
        for place, (electrode, reading) in enumerate(pairs):
            least_s[electrode] = own.least_s[place]
            self._bound_own(electrode, reading.least_ohm, own.back_ohm[place])
        self.least_s, self._known_s = least_s, sum(least_s)
        for electrode, seen in enumerate(self._readings):
            self._taken_ohm[electrode] = math.inf if seen is None else seen.least_ohm
            if seen is not None and self._known_s > 0.0 and self._is_open(electrode, now_ns):
                self._bound_own(electrode, seen.least_ohm, 1.0 / self._known_s)
        if not self._is_sparse:
            best_s = max((1.0 / ohm for ohm, _ in self._own_ohm if ohm > 0.0), default=0.0)
            self._best_s = max(best_s, self._best_before_s)

    def _bound_own(self, electrode: int, path_ohm: float, back_ohm: float) -> None:
        """By the way back as it is known now, or as it was before; the closer bound counts."""
        before_ohm, then_ohm = self._own_ohm[electrode]
        before_ohm -= max(0.0, then_ohm - path_ohm)
        now_ohm = path_ohm - back_ohm
        if now_ohm >= before_ohm:
            self._own_ohm[electrode] = now_ohm, path_ohm
        ohm = max(now_ohm, before_ohm)
        self.most_s[electrode] = 1.0 / ohm if ohm > 0.0 else math.inf

    def share(self, electrode: int) -> float:
        """The part of this electrode's current that the best of all others may carry; `weights`
        gives the part of that for each of them. Above 1 where the best may not be among the known
        ones: it may carry the whole current then. 1 where no other is known; never more while few
        are, when no weight is above 1. As of the last `refresh`.
        """
        others_s = self._known_s - self.least_s[electrode]
        if others_s <= 0.0 or self._best_s <= 0.0:
            return 1.0
        share = self._best_s / others_s
        return min(1.0, share) if self._is_sparse else share

    def weights(self, now_ns: int) -> list[float]:
        """By electrode: the most that it conducts, divided by the best that was measured. None
        counts for less than an equal part (`return_caps.py`).
        """
        best_s = self._best_s
        if best_s <= 0.0 or self._is_sparse:
            return [1.0] * self._electrodes
        equal_s = self._known_s / max(1, len(self._known))
        found = []
        for electrode, own_s in enumerate(self.most_s):
            is_read = self._readings[electrode] is not None
            weight = min(max(own_s, equal_s) / best_s, _WHOLE) if is_read else 1.0
            found.append(weight if self.is_known(electrode, now_ns) else max(1.0, weight))
        return found

    def parts(self, now_ns: int) -> tuple[list[float], list[float]]:
        """By electrode, what it likely conducts of all, and the most that it may: nearer to what is
        than `weights`, which bound it. 0 where nothing touches. An unknown one conducts as well as
        the best; where few are known, all are alike.
        """
        known = {one: it for one in sorted(self._known) if (it := self._readings[one])}
        if self._is_sparse or not known:
            even = [1.0 / self._electrodes] * self._electrodes
            return even, even
        found = self._parts_of(list(known.values()))
        best = max(found[0])
        each = [0.0 if self._is_open(one, now_ns) else best for one in range(self._electrodes)]
        likely, most = each, list(each)
        for place, one in enumerate(known):
            likely[one], most[one] = found[0][place], found[1][place]
        return likely, most

    def _parts_of(self, readings: Sequence[Reading]) -> tuple[list[float], list[float]]:
        """Of those that are known, in their order: the likely ones, and the most."""
        best_s = [_conducts_s(min(reading.least_ohm, _MOST_OHM)) for reading in readings]
        worst_s = [_conducts_s(reading.most_ohm) for reading in readings]
        between_s = [_between(*both) for both in zip(worst_s, best_s, strict=True)]
        likely = likely_parts(between_s)
        # The rise takes longer by the way back, which is that part of the path.
        paths_ohm = [
            self._meter.most_ohm(reading, _WAY_BACK * part / path_s)
            for reading, part, path_s in zip(readings, likely, between_s, strict=True)
        ]
        return likely, most_parts([_conducts_s(ohm) for ohm in paths_ohm], best_s)

    # --- contact polls ---------------------------------------------------------------------------

    def want(self) -> None:
        """What is unknown of the returns may limit a pulse, or exceed their bounds. From now on
        every electrode is polled that no pulse measures.
        """
        self.is_wanted = True

    def looked_ns(self, electrode: int) -> int:
        """When it was measured last; 0 after the loss of a contact."""
        return self._looked_ns[electrode] or 0

    def is_due(self, electrode: int, now_ns: int) -> bool:
        """Whether it is due for a contact poll: no pulse measured it, or none was read."""
        for then_ns in (self._looked_ns[electrode], self._read_ns[electrode]):
            if then_ns is None or now_ns - then_ns >= CONTACT_POLL_NS:
                return True
        return False


def _conducts_s(path_ohm: float) -> float:
    return 1.0 / max(path_ohm, _LEAST_OHM)


def _between(least_s: float, most_s: float) -> float:
    """Of a path that may resist anything, what it conducts at most."""
    return math.sqrt(least_s * most_s) if least_s > 0.0 else most_s
