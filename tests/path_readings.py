"""Readings of paths, exact ones and such as the fake's skin gives.

Owns: what a board would have sampled of a contact among others. Must not know: what follows of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from etd.files.configuration import fake_config
from etd.safety.conductance import PathMeter, PathSamples, Reading, Whole
from etd_body.electrode import Contact
from etd_body.interface import Side
from etd_body.minimal import MinimalBody

SOURCE = fake_config(board="kajimoto-hv507").board.source
METER = PathMeter(SOURCE)
_STEP_V = SOURCE.node_uv_per_code / 1e6
_EARLY_NS, _BEFORE_END_NS, _LEAST_WITH_END_US = 10_000, 6_000, 33


def exact(path_ohm: float, current_ua: float = 300.0) -> Reading:
    """Of a path that is known to the ohm."""
    node_v = current_ua / 1e6 / (1.0 / path_ohm + 1.0 / SOURCE.leak_ohm)
    whole = Whole(current_ua, node_v, node_v, node_v, 3.4, path_ohm, 0.0)
    return Reading(current_ua, path_ohm, path_ohm, whole)


def paths_ohm(contacts: Sequence[Contact]) -> list[float]:
    """Of each contact against all others, after long."""
    whole_s = sum(contact.conductance_s for contact in contacts)
    return [
        math.inf
        if contact.conductance_s in (0.0, whole_s)
        else contact.resistance_ohm + 1.0 / (whole_s - contact.conductance_s)
        for contact in contacts
    ]


def code_of(current_ua: int) -> int:
    return int(current_ua * (SOURCE.codes - 1) / SOURCE.full_scale_ua)


def sampled(
    contacts: Sequence[Contact],
    electrode: int,
    current_ua: int,
    width_us: int,
    *,
    has_prepulse: bool = False,
    probe: tuple[int, int, int] | None = None,
) -> PathSamples:
    """The samples of one pulse on skin at rest, or after a probe: its current in uA, its width and
    the time after it, in us, in which the leak alone discharges what it left.
    """
    commanded_ua = code_of(current_ua) * SOURCE.full_scale_ua / (SOURCE.codes - 1)
    body = MinimalBody(contacts, leak_ohm=SOURCE.leak_ohm, compliance_v=float(SOURCE.compliance_v))
    sides = tuple(
        Side.SOURCE if other == electrode else Side.GROUND for other in range(len(contacts))
    )
    begun_ns, resting_v = 0, 0.0
    if probe is not None:
        probe_ua, probe_us, rest_us = probe
        body.drive(0, float(probe_ua), sides)
        body.drive(probe_us * 1_000, 0.0, sides)
        begun_ns = (probe_us + rest_us) * 1_000
        resting_v = _in_steps(body.node_voltage_v(begun_ns))
    body.drive(begun_ns, commanded_ua, sides)
    early_v = _in_steps(body.node_voltage_v(begun_ns + _EARLY_NS))
    last_v, has_end = early_v, width_us > _LEAST_WITH_END_US
    if has_end:
        last_v = _in_steps(body.node_voltage_v(begun_ns + width_us * 1_000 - _BEFORE_END_NS))
    return PathSamples(
        code_of(current_ua), float(width_us), has_end, has_prepulse, resting_v, early_v, last_v
    )


def _in_steps(node_v: float) -> float:
    return round(node_v / _STEP_V) * _STEP_V
