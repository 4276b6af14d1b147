"""How long a second of the body behind the fake takes: skin, source and nerves alone.

Owns: the scan that is played on it and the measuring. Must not know: boards, tables.
"""

from __future__ import annotations

import resource
from dataclasses import dataclass

from etd_body.course import BUSY
from etd_body.interface import Side, Sides
from etd_body.living import LivingBody

#: Sixty scans of all electrodes, at 2 mA and 100 us.
SCANS, CURRENT_UA, WIDTH_US = 60, 2_000, 100
_SECOND_NS, _DISCHARGE_NS = 1_000_000_000, 2_000
_PITCH_MM = 2.5


@dataclass(frozen=True)
class BodyFigures:
    """Processor seconds for one simulated second of scanning, and per pulse."""

    electrodes: int
    setup_s: float
    busy_s: float
    pulse_us: float


def measure(side: int) -> BodyFigures:
    """A square of `side` electrodes a side on a finger that sweats, presses and peels."""
    count = side * side
    places = [
        (_PITCH_MM * (electrode % side), _PITCH_MM * (electrode // side))
        for electrode in range(count)
    ]
    begun_s = _used_s()
    body = LivingBody(places, leak_ohm=66_000, compliance_v=300.0, seed=1, script=BUSY)
    set_up_s = _used_s()
    alone = [_alone(electrode, count) for electrode in range(count)]
    grounded: Sides = (Side.GROUND,) * count
    visit_ns = _SECOND_NS // (SCANS * count)
    t_ns = _SECOND_NS
    for _ in range(SCANS):
        for sides in alone:
            body.drive(t_ns, CURRENT_UA, sides)
            body.node_voltage_v(t_ns + WIDTH_US * 900)
            body.drive(t_ns + WIDTH_US * 1_000, 0, sides)
            body.drive(t_ns + WIDTH_US * 1_000 + _DISCHARGE_NS, 0, grounded)
            t_ns += max(visit_ns, WIDTH_US * 1_000 + 2 * _DISCHARGE_NS)
    body.take_felt()
    busy_s = _used_s() - set_up_s
    return BodyFigures(count, set_up_s - begun_s, busy_s, busy_s * 1e6 / (SCANS * count))


def _alone(electrode: int, count: int) -> Sides:
    return tuple(Side.SOURCE if other == electrode else Side.GROUND for other in range(count))


def _used_s() -> float:
    """Processor time of this process so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
