"""What the kernel does with the scan's core, read beside the scan, with its age.

Owns: how often it is read, and that an old answer is none. Must not know: where it is read, what
follows from it, where it is kept (`readings.py`).

As with the sensors, the same class stands on both sides: one calls `read`, the other asks.

A throttle that is switched on while the scan is 98 % busy takes the thread off after 950 ms of a
second, or 0.95 s of the fair server's. Read four times a second, and unknown after half a second,
it is known soon enough for the scan to stay below that.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.sensing.readings import Readings
from etd_hal.bench import ScanCore
from etd_hal.ports import Clock

#: In the readings.
CORE_SLOT = 1
_EVERY_NS = 250_000_000
#: An answer older than this is none.
STALE_NS = 500_000_000


class ScanCoreReading:
    """See the module. `ask` is None where it is not read."""

    def __init__(
        self, readings: Readings, clock: Clock, ask: Callable[[], ScanCore] | None = None
    ) -> None:
        self._readings = readings
        self._clock = clock
        self._ask = ask
        self._next_ns = clock.now_ns()

    def read(self) -> None:
        """Called as often as one likes. Never raises."""
        if self._ask is None or (now_ns := self._clock.now_ns()) < self._next_ns:
            return
        self._next_ns = now_ns + _EVERY_NS
        found = self._ask()
        # The time of before the files were read.
        self._readings.put(CORE_SLOT, float(found.is_left_alone), now_ns)
        self._readings.tell(CORE_SLOT, str(found), now_ns)

    def is_left_alone(self, now_ns: int) -> bool:
        """No matter what, the kernel never takes the scan's thread off its core. False where that
        is not known.
        """
        latest = self._readings.latest(CORE_SLOT)
        return latest is not None and latest[0] == 1.0 and now_ns - latest[1] <= STALE_NS

    def told(self, now_ns: int) -> str:
        """A sentence."""
        text, read_ns = self._readings.told(CORE_SLOT)
        return text if text and now_ns - read_ns <= STALE_NS else "not known: it was not read"
