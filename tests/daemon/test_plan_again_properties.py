"""A plan is what it would be without the frames before, whatever of it was decided for them."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Sequence
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_parts import body_site, calibration, frame, planner
from etd.planning.outlook import Outlook
from etd.planning.plan import Planner
from etd.protocol.errors import Refused
from etd.protocol.frame import Frame
from etd.pulse.request import MaxGain
from etd.safety.limits import Path
from etd.stabilize.bursts import Bursts
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings
from etd.stabilize.strength_duration import StrengthDuration
from plain_records import told

pytestmark = pytest.mark.slow

N = 16
#: By order, what a body site may name.
SITES: Sequence[dict[str, Any]] = (
    {},
    {"probe_first": True},
    {"order": ("prepulse",), "prepulse": Prepulse(below_db=4.0, width_us=40)},
    {
        "order": ("strength_duration",),
        "strength_duration": StrengthDuration(width_us=60, tau_us=151.0),
    },
    {"bursts": Bursts(pulses=2, rate_hz=400.0)},
)
N_FRAMES = 25


def next_asked(rng: random.Random, before: dict[str, Any]) -> dict[str, Any]:
    """The same as in the frame before, but for one thing; some of it is refused."""
    widths_us, rates_hz = (40, 60, 80, 150), (10.0, 15.0, 30.0, 200.0)
    choices = {
        "parts": tuple(rng.choice((0.0, 0.1, 0.5, rng.random(), 1.0)) for _ in range(N)),
        "is_level": rng.random() < 0.5,
        "most_ua": rng.choice((100, 900, 2_000, 6_000)),
        "return_ua": rng.choice((300.0, 900.0, 90_000.0)),
        "ceiling_ua": rng.choice((0, 700, 6_000, 6_000)),
        "recontacts_ua": rng.choice(({}, {}, {1: 200, 4: 5_000})),
        "is_touched": rng.choice(([None] * N, [electrode % 3 != 2 for electrode in range(N)])),
        "width_us": rng.choice((60, 150, tuple(rng.choice(widths_us) for _ in range(N)))),
        "rate_hz": rng.choice((10.0, 15.0, tuple(rng.choice(rates_hz) for _ in range(N)))),
        "polarity": rng.choice(("anodic", "biphasic")),
        "returns": rng.choice((None, "all", ((1,), *((0,),) * (N - 1)))),
        "allow_slower": rng.random() < 0.8,
        "strict": rng.random() < 0.1,
    }
    if not before:
        return choices
    name = rng.choice(("parts", *choices))
    return {**before, name: choices[name]}


def asked_frame(asked: dict[str, Any], *, is_calibrated: bool) -> Frame:
    fields = dict(asked)
    parts, is_level = fields.pop("parts"), fields.pop("is_level")
    most_ua = fields.pop("most_ua")
    for known in ("return_ua", "ceiling_ua", "recontacts_ua", "is_touched"):
        del fields[known]
    if is_level and is_calibrated:
        # A level has the conditions of its calibration.
        return frame(level=parts, allow_slower=True)
    return frame(current_ua=tuple(int(part * most_ua) for part in parts), **fields)


@settings(deadline=None, max_examples=50)
@given(site=st.sampled_from(SITES), is_calibrated=st.booleans(), seed=st.integers(0, 1_000_000))
def test_each_plan_or_refusal_is_that_of_a_planner_that_has_planned_nothing(
    site: dict[str, Any], is_calibrated: bool, seed: int
) -> None:
    def new() -> Planner:
        stabilize = Settings(**site)
        made = calibration(shape=stabilize.shape) if is_calibrated else None
        return planner(
            caps_ua=tuple(range(400, 400 + 100 * N, 100)),
            calibrated=made,
            site=msgspec.structs.replace(body_site(), stabilize=stabilize),
            max_gain=MaxGain(2.0, 1.0, 2.0),
        )

    rng, plans = random.Random(seed), new()
    asked: dict[str, Any] = {}
    #: By what they let through and electrode: the same path is the same object, as in the engine.
    paths: dict[tuple[float, int], Path] = {}
    for _ in range(N_FRAMES):
        asked = next_asked(rng, asked)

        def returns(path: Path, return_ua: float = asked["return_ua"]) -> Path:
            return paths.setdefault((return_ua, path.electrode), path.with_returns(return_ua, 0))

        outlook = Outlook(
            returns, asked["ceiling_ua"], asked["recontacts_ua"], asked["is_touched"], lambda *_: 0
        )
        wanted = asked_frame(asked, is_calibrated=is_calibrated)
        assert outcome(plans, wanted, outlook) == outcome(new(), wanted, outlook)


def outcome(plans: Planner, wanted: Frame, outlook: Outlook) -> object:
    try:
        plan = plans.plan(wanted, outlook)
    except Refused as refusal:
        return refusal.code, refusal.reason, refusal.electrode
    parts = {field.name: getattr(plan, field.name) for field in dataclasses.fields(plan)}
    return {**parts, "schedule": [told(pulse) for pulse in plan.schedule]}
