"""What all electrodes have in common for long widens no pulse.

Owns: what is common, over how long, and when it is reported. Must not know: what a law depends on,
limits.

A reading that is wrong by the same factor (another divider before the ADC, a gain that drifted) is
wrong for all electrodes at once, and skin is not: each electrode's has a way of its own, and what a
finger does to all of them, pressing harder and lighter, comes and goes within seconds. So the
median over the electrodes of what a law wants, averaged over 20 s, is taken back from the widening
of every electrode. Narrowing is left, and no electrode gets less than the frame wants by it. On the
busiest modelled fingers (seeds 1 and 2) that average is hardly ever above 1; under a gain of 0.7,
which alone would hold `power_law` near its widest for 59 and 70 % of the time, it takes so much
back that 11 and 11 % are left, as with the right gain (7 and 10 %).

It takes skin along that is wetter everywhere than when it was calibrated: the mean is then what the
frame makes of such skin. Few electrodes have no common mode, and the common mode of many is dropped
when they have had no pulse for a second.
"""

from __future__ import annotations

import math
from statistics import median

from etd.pulse.measured import MAX_AGE_NS, is_stale
from etd.stabilize.pipeline import OnRejected

#: The least number of electrodes with a pulse within a second.
QUORUM = 4
_AVERAGED_NS = 20_000_000_000
_LOOK_NS = 100_000_000
#: As logarithms: a common factor above the first is reported, below the second it may be reported
#: again.
_TOLD, _FORGIVEN = math.log(1.25), math.log(1.1)


class CommonMode:
    """For all electrodes of one law. `on_rejected` hears "common" when much is taken back."""

    def __init__(self, on_rejected: OnRejected) -> None:
        self._on_rejected = on_rejected
        self._wanted: dict[int, tuple[float, int]] = {}
        self._checked_ns: int | None = None
        self._is_reported = False
        self._averaged = 0.0
        self._averaged_ns = 0
        #: When enough of them have asked last.
        self._many_ns: int | None = None

    def report_again(self) -> None:
        """Report again, if it still holds at the next check."""
        self._is_reported = False

    def without_common(self, electrode: int, wanted: float, now_ns: int) -> float:
        """What a law wants, as a factor, without what all have wanted for long."""
        self._wanted[electrode] = (math.log(wanted), now_ns)
        since_ns = _LOOK_NS if self._checked_ns is None else now_ns - self._checked_ns
        if since_ns >= _LOOK_NS:
            self._checked_ns = now_ns
            self._check(now_ns, min(since_ns, MAX_AGE_NS))
        if wanted <= 1.0 or self._averaged <= 0.0:
            return wanted
        return max(1.0, wanted * math.exp(-self._averaged))

    def _check(self, now_ns: int, since_ns: int) -> None:
        wanted = [log for log, then_ns in self._wanted.values() if now_ns - then_ns < MAX_AGE_NS]
        if is_stale(self._many_ns, now_ns):
            self._averaged, self._averaged_ns = 0.0, 0
        if len(wanted) < QUORUM:
            return
        self._many_ns = now_ns
        self._averaged_ns = min(self._averaged_ns + since_ns, _AVERAGED_NS)
        self._averaged += since_ns / self._averaged_ns * (median(wanted) - self._averaged)
        self._report()

    def _report(self) -> None:
        if self._averaged < _FORGIVEN:
            self._is_reported = False
        elif self._averaged >= _TOLD and not self._is_reported:
            self._is_reported = True
            self._on_rejected("common")
