"""What this machine computes for a pulse, measured from scan to scan, for plans.

Owns: the measured figures, the machine file's until there are any, and by how much scans still take
longer than planned. Must not know: what is computed, schedules, the board.

What of a scan is neither waited nor on the wire was computed, whatever it was for: pulses, polls,
the scan's own beginning. So the figure holds for whole scans. Arming measures it first, by the
probes. What lies between two scans is measured apart: it is the same for few pulses and for many.
"""

from __future__ import annotations

import statistics
from collections import deque

from etd.engine.cpu_budget import CpuBudget
from etd_hal.cost import BETWEEN_PART, IDLE_PART

#: Scans of fewer pulses compute more for each: a scan's own work is shared by few.
_FEWEST_PULSES = 8
#: The median of so many scans, which no single stall moves.
_SCANS = 9
#: What a second without lateness takes back.
_RELIEF = 0.95


class MeasuredComputing:
    """See the module. Implements `etd_hal.cost.Computing`."""

    def __init__(self, clock: CpuBudget, filed_us: float) -> None:
        self._clock = clock
        self.pulse_us = filed_us
        #: How many times as long as planned scans take.
        self.stretch = 1.0
        self._samples_us: deque[float] = deque(maxlen=_SCANS)
        self._begun_ns = self._waited_ns = 0
        self._between_us: deque[float] = deque(maxlen=_SCANS)
        #: When the scan before was over; what was waited and planned until then, and how often it
        #: was waited. None: no scan was before.
        self._last_end: tuple[int, int, int] | None = None

    @property
    def between_us(self) -> float:
        """From the end of a scan to the beginning of the next, the planning of frames left out: it
        is no part of each scan, and a frame must not be refused for the frames before it.
        """
        found = self._between_us
        # All of them, or stalls could be most of the few.
        known = len(found) == _SCANS
        return statistics.median(found) if known else BETWEEN_PART * self.pulse_us

    @property
    def spun_us(self) -> float:
        """Of each sleep."""
        return self._clock.wakeups.spin_ns / 1_000

    @property
    def busy_fraction(self) -> float:
        """What the kernel leaves the scan of the time."""
        return self._clock.busy_fraction

    def scan_ended(self, now_ns: int, planning_ns: int) -> None:
        """A scan is over, and the next one follows. `planning_ns`: spent on frames so far."""
        self._last_end = now_ns, self._clock.waited_ns + planning_ns, self._clock.dozes

    def scans_ended(self) -> None:
        """No scan follows."""
        self._last_end = None

    def begin(self, now_ns: int, planning_ns: int = 0) -> None:
        """A scan or a measurement begins. `planning_ns`: as in `scan_ended`."""
        if self._last_end is not None:
            since_ns, apart_ns, dozes = self._last_end
            between_ns = now_ns - since_ns - (self._clock.waited_ns + planning_ns - apart_ns)
            # Polls between two dozes are in the plan already.
            idle_us = max(0, self._clock.dozes - dozes - 1) * IDLE_PART * self.pulse_us
            self._between_us.append(max(0.0, between_ns / 1_000 - idle_us))
            self._last_end = None
        self._begun_ns, self._waited_ns = now_ns, self._clock.waited_ns

    def end(self, now_ns: int, pulses: int, wire_us: float) -> None:
        """So many pulses were fired since; messages and calls took `wire_us`."""
        if pulses < _FEWEST_PULSES:
            return
        waited_ns = self._clock.waited_ns - self._waited_ns
        computed_us = (now_ns - self._begun_ns - waited_ns) / 1_000 - wire_us
        self._samples_us.append(max(0.0, computed_us / pulses))
        self.pulse_us = statistics.median(self._samples_us)

    def came_late(self, ratio: float) -> None:
        """For a second scans took so many times as long as planned."""
        self.stretch *= ratio

    def came_in_time(self) -> None:
        """For a second they did not."""
        self.stretch = max(1.0, self.stretch * _RELIEF)
