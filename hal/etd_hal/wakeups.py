"""By how much sleeps end late on this machine, and what of the next one is spun for it.

Owns: the lateness of the last sleeps. Must not know: clocks, who sleeps.

A sleep is asked to end early, and what is left is spun, so that it ends exactly. What is spun is
time of the processor: as little as the machine's own wake-ups need.
"""

from __future__ import annotations

from typing import Final, Protocol

from etd_hal.ports import SPIN_NS, WakingClock

#: Going to sleep and reading the clock afterwards take a few us themselves.
LEAST_SPIN_NS: Final = 10_000
#: The margin: a quarter of the lateness, and this.
_MARGIN_NS: Final = 2_000
_BLOCKS: Final = 8
_BLOCK: Final = 32
#: Before so many wake-ups nothing is known.
_ENOUGH: Final = 2 * _BLOCK


class WakeUps:
    """See the module. What is spun follows the second highest of the worst of each 32 wake-ups, of
    the last 256: a single stall does not move it, and two thirds of a percent of them are later.
    """

    __slots__ = ("_worst_ns", "late", "noted", "spin_ns")

    def __init__(self) -> None:
        #: Of each sleep this much at its end is spun.
        self.spin_ns = SPIN_NS
        self.noted = 0
        #: Wake-ups that came later than what was spun for them.
        self.late = 0
        self._worst_ns = [0] * _BLOCKS

    def note(self, late_ns: int) -> None:
        """A sleep that was to end `spin_ns` before its deadline has ended so late."""
        if late_ns > self.spin_ns:
            self.late += 1
        number = self.noted
        self.noted = number + 1
        block = number // _BLOCK % _BLOCKS
        if number % _BLOCK and late_ns <= self._worst_ns[block]:
            return
        self._worst_ns[block] = late_ns
        if number >= _ENOUGH:
            usual_ns = sorted(self._worst_ns)[-2]
            wanted_ns = usual_ns + usual_ns // 4 + _MARGIN_NS
            self.spin_ns = min(SPIN_NS, max(LEAST_SPIN_NS, wanted_ns))


class NotingClock(WakingClock, Protocol):
    """A clock that notes its own sleeps."""

    wakeups: WakeUps
