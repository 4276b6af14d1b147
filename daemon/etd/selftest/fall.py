"""How a rail falls, by its monitor: when it was cut, and when it was gone.

Owns: both times, the tolerance of the first, and that a fall which the test itself may have caused
proves nothing. Must not know: why it falls.

The storage capacitor discharges slowly. The time of the cut is estimated from the readings between
2 % and 10 % down, by a line through their logarithms. The estimate is exact for a bleeder; a load
of constant current makes it late by less than 0.2 % of the fall. If a fall is too fast for three
such readings, the first one counts.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from math import log as ln

from etd.selftest.fixture import MS, Fixture
from etd.selftest.log import CheckLog
from etd_hal.boardfile import RailMonitor

#: A reading: after how many ms, how many volts.
Reading = tuple[float, float]

#: The cut is estimated from readings between these parts of the rail before.
_SEEN, _DEEP = 0.98, 0.9
_LEAST_READINGS = 3
#: The most by which the cut is estimated too late, as a part of the time until `off_v`.
_RECKONED_LATE = 0.002
#: A monostable's own tolerance, and a few readings.
_TOLERANCE = 1.2
_READINGS_MS = 10
#: Between readings once the cut is known: the fall's end is a matter of seconds.
_LATER_MS = 10


@dataclass(frozen=True, slots=True)
class Fall:
    """In ms after what should make it fall; None for what did not happen in time."""

    cut_ms: float | None
    gone_ms: float | None

    def is_cut_within(self, most_ms: float) -> bool:
        """False if no fall was measured."""
        return self.cut_ms is not None and self.cut_ms <= most_ms

    @property
    def cut_text(self) -> str:
        return "does not fall" if self.cut_ms is None else f"is cut after {self.cut_ms:.0f} ms"


def reckoned_within_ms(monitor: RailMonitor, guard_ms: float) -> float:
    """The latest estimate of a cut by a guard that acts within `guard_ms`."""
    return guard_ms * _TOLERANCE + monitor.fall_ms * _RECKONED_LATE + _READINGS_MS


def reckon_cut(readings: Sequence[Reading], from_v: float) -> float | None:
    """When a rail at `from_v` was cut, estimated from its fall; None if it did not fall."""
    begun_ms = next((ms for ms, volts in readings if volts < _SEEN * from_v), None)
    if begun_ms is None:
        return None
    upper = [
        (ms, ln(volts / from_v))
        for ms, volts in readings
        if ms >= begun_ms and volts >= _DEEP * from_v
    ]
    if len(upper) < _LEAST_READINGS:
        return begun_ms
    slope, at_zero = statistics.linear_regression(*zip(*upper, strict=True))
    return min(begun_ms, -at_zero / slope) if slope < 0 else begun_ms


def watch_fall(
    fixture: Fixture,
    monitor: RailMonitor,
    from_v: float,
    within_ms: float,
    since_ns: int,
) -> Fall:
    """From `from_v` until it is off, or time is over. Raises: BusError."""
    readings: list[Reading] = []
    while True:
        rail_v = fixture.rail_v(is_beating=False)
        now_ms = (fixture.clock.now_ns() - since_ns) / MS
        readings.append((now_ms, rail_v))
        if rail_v < monitor.off_v:
            return Fall(reckon_cut(readings, from_v), now_ms)
        if now_ms > within_ms:
            return Fall(reckon_cut(readings, from_v), None)
        if rail_v < _DEEP * from_v:
            fixture.wait_ms(_LATER_MS, is_beating=False)


_BEAT_ADVICE = (
    "other programs on this machine delayed the test's heartbeat, which may have cut the supply:"
    " end them, and test again"
)


def judge_fall(
    log: CheckLog,
    missed_ms: float | None,
    name: str,
    is_good: bool,
    measured: str,
    expected: str,
    advice: str,
) -> bool:
    """As `CheckLog.judge`; never a pass if the test missed a beat (`Beats.missed_ms`)."""
    if missed_ms is None:
        return log.judge(name, is_good, measured, expected, advice)
    return log.judge(
        name,
        False,
        f"the test missed a heartbeat for {missed_ms:.0f} ms; {measured}",
        expected,
        _BEAT_ADVICE if is_good else advice,
    )
