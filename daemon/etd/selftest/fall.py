"""How a rail falls, by its monitor: when that began, and when it was gone.

Owns: both moments, how soon after a guard's time the first can be seen, and that a fall which the
test itself may have caused proves nothing. Must not know: why it falls.

A store falls slowly, so its beginning says when the supply was cut, and its end what the bleeder
does. A fall is seen when a fiftieth is gone.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.selftest.bed import MS, Bed
from etd.selftest.log import Log
from etd_hal.boardfile import RailMonitor

_SEEN = 0.98
#: Of the time until `off_v`, a steady fall takes this much to lose a fiftieth.
_SEEN_LATE = 0.02
#: A monostable's own tolerance, and a few readings.
_TOLERANCE = 1.2
_READINGS_MS = 10
#: Between readings once it falls: its end is a matter of seconds.
_LATER_MS = 10


@dataclass(frozen=True, slots=True)
class Fall:
    """In ms after whatever should make it fall; None for what did not come in time."""

    begun_ms: float | None
    gone_ms: float | None

    def begun_within(self, most_ms: float) -> bool:
        """A fall that was not seen to begin did not begin in time."""
        return self.begun_ms is not None and self.begun_ms <= most_ms

    @property
    def told_begun(self) -> str:
        if self.begun_ms is None:
            return "is not seen to fall"
        return f"falls after {self.begun_ms:.0f} ms"


def seen_within_ms(monitor: RailMonitor, guard_ms: float) -> float:
    """By when the fall is seen to have begun, if the guard acts within `guard_ms`."""
    return guard_ms * _TOLERANCE + monitor.fall_ms * _SEEN_LATE + _READINGS_MS


def watch_fall(
    bed: Bed,
    monitor: RailMonitor,
    from_v: float,
    within_ms: float,
    since_ns: int,
) -> Fall:
    """From `from_v` until it is off, or time is over. Raises: BusError."""
    begun_ms = None
    while True:
        rail_v = bed.rail_v(is_beating=False)
        now_ms = (bed.clock.now_ns() - since_ns) / MS
        if begun_ms is None and rail_v < _SEEN * from_v:
            begun_ms = now_ms
        if rail_v < monitor.off_v:
            return Fall(begun_ms, now_ms)
        if now_ms > within_ms:
            return Fall(begun_ms, None)
        if begun_ms is not None:
            bed.wait_ms(_LATER_MS, is_beating=False)


_BEAT_ADVICE = (
    "what else runs on this machine kept the test from beating in time, so that the supply may have"
    " gone for that alone: end that, and begin again"
)


def judge_fall(
    log: Log,
    missed_ms: float | None,
    name: str,
    is_good: bool,
    measured: str,
    expected: str,
    advice: str,
) -> bool:
    """As `Log.judge`; with a beat missed by the test (`Bed.missed_ms`) it never passes."""
    if missed_ms is None:
        return log.judge(name, is_good, measured, expected, advice)
    return log.judge(
        name,
        False,
        f"the test itself missed a beat: {missed_ms:.0f} ms; {measured}",
        expected,
        _BEAT_ADVICE if is_good else advice,
    )
