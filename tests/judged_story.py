"""A story told to an engine, step by step, and judged by the oracle on its wires.

Owns: the steps, the eight electrodes that stories have, and what judging one means. Must not know:
which stories are told.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from engine_oracle import Oracle
from etd.files.body_site import SiteMaxima
from story_teller import Teller
from trace_rules import violations

ELECTRODES = 8
REST_US = 200
#: One visit: a jump through the whole chain, the rest, two phases; relays take their time.
HALF_BRIDGE_SLOT_NS = 1_500_000
RELAY_SLOT_NS = 15_000_000
SLOTS = {
    "kajimoto-hv507": HALF_BRIDGE_SLOT_NS,
    "reference-hv507": HALF_BRIDGE_SLOT_NS,
    "feetthrough-relay": RELAY_SLOT_NS,
}

electrodes = st.integers(0, ELECTRODES - 1)

stories = settings(
    deadline=None,
    max_examples=25,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)

WIDE_OPEN = SiteMaxima(
    uncalibrated_current_ua=3_000,
    current_ua=3_000,
    width_us=200,
    charge_nc=500,
    rate_hz=120,
    interval_us=2_000,
    mean_current_ua=30,
    array_mean_current_ua=2_000,
    on_us_per_s=24_000,
    array_on_us_per_s=500_000,
    net_charge_nc=15_000,
)


class Step(NamedTuple):
    """A verb of the teller's, and what it is told."""

    verb: str
    told: dict[str, Any]


def judged(teller: Teller, caps_ua: tuple[int, ...], told: list[Step]) -> Oracle:
    """Tell a story from an armed engine on, and judge it."""
    teller.open(caps_ua)
    teller.arm()
    for verb, choices in told:
        getattr(teller, verb)(**choices)
    trace = teller.end()
    assert violations(trace, REST_US) == []
    oracle = Oracle(teller.story, trace)
    oracle.check_all()
    return oracle
