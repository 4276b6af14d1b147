"""A calibration and a body site that makes other pulses than it was made with: what is refused."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from engine_parts import board_file, body_site, calibration, currents, frame, planner
from etd.planning.plan import Planner
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.stabilize.bursts import Bursts
from etd.stabilize.law_settings import PowerLawSettings
from etd.stabilize.pipeline import max_gain_of
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings, pipeline
from etd.stabilize.shape import Shape
from etd.stabilize.strength_duration import StrengthDuration

LEVELS = (1.0,) + (0.0,) * 15


def test_levels_of_plain_pulses_are_refused_where_the_site_makes_others_of_them() -> None:
    prepulse = Prepulse(below_db=6.0, width_us=50)
    settings = Settings(order=("prepulse",), prepulse=prepulse, probe_first=True)
    site = msgspec.structs.replace(body_site(), stabilize=settings)
    with pytest.raises(Refused, match="makes a prepulse of 50 us, 6 dB below, a probe before each"):
        planner(calibrated=calibration(), site=site).plan(frame(level=LEVELS))

    led_into = calibration(shape=settings.shape)
    assert planner(calibrated=led_into, site=site).plan(frame(level=LEVELS)).schedule
    with pytest.raises(Refused, match="level means what it was calibrated to"):
        planner(calibrated=led_into).plan(frame(level=LEVELS))


BURSTING = Settings(bursts=Bursts(pulses=2, rate_hz=200.0))
LED = Settings(order=("prepulse",), prepulse=Prepulse(below_db=6.0, width_us=50))
PROBING = Settings(probe_first=True)


@pytest.mark.parametrize("settings", [BURSTING, LED, PROBING])
def test_caps_accepted_with_other_pulses_are_no_caps_for_these(settings: Settings) -> None:
    site = msgspec.structs.replace(body_site(), stabilize=settings)
    asked = frame(current_ua=currents(e0=500), rate_hz=20.0)
    silent = frame(current_ua=currents())
    for made, here in ((calibration(), site), (calibration(shape=settings.shape), body_site())):
        with pytest.raises(Refused, match="caps were accepted with") as refusal:
            planner(calibrated=made, site=here).plan(asked)
        assert refusal.value.code == "bad_frame"
        assert not planner(calibrated=made, site=here).plan(silent).schedule
    of_this_shape = calibration(shape=settings.shape)
    assert planner(calibrated=of_this_shape, site=site).plan(asked).schedule
    assert planner(site=site).plan(asked).schedule, "limits are of no calibration"


NARROW = StrengthDuration(width_us=50, tau_us=151.0)
FITTED = PowerLawSettings(max_widening=4.0)


def narrowing(*order: str, made: Calibration | None = None) -> Planner:
    """For a site with these laws, with the room that they ask for."""
    laws: dict[str, Any] = {"strength_duration": NARROW, "power_law": FITTED}
    settings = Settings(order=order, **{name: laws[name] for name in order})  # type: ignore[arg-type]
    site = msgspec.structs.replace(body_site(), stabilize=settings)
    max_gain = max_gain_of(pipeline(settings, board_file().source))
    return planner(calibrated=made, site=site, max_gain=max_gain)


@pytest.mark.parametrize("made", [None, calibration()])
@pytest.mark.parametrize("is_strict", [False, True])
def test_a_current_is_refused_where_it_would_be_made_a_stronger_one(
    made: Calibration | None, is_strict: bool
) -> None:
    plan = narrowing("strength_duration", made=made).plan
    asked = frame(current_ua=currents(e0=500, e3=500), strict=is_strict)
    for width_us in (51, (50,) * 3 + (51,) + (50,) * 12):
        with pytest.raises(Refused, match="send width_us of at most 50, where") as refusal:
            plan(msgspec.structs.replace(asked, width_us=width_us))
        assert refusal.value.code == "bad_frame"
        assert refusal.value.electrode == (0 if width_us == 51 else 3)
    for width_us in (50, (50, 51) + (50,) * 14):
        assert plan(msgspec.structs.replace(asked, width_us=width_us)).schedule
    assert not plan(frame(current_ua=currents())).schedule, "silence has no width"


def test_a_current_without_a_width_is_refused_by_the_width_that_holds_then() -> None:
    asked = frame(current_ua=currents(e0=500))
    with pytest.raises(Refused, match="pulses of 100 us narrower and stronger"):
        narrowing("strength_duration", made=calibration()).plan(asked)
    assert narrowing("strength_duration", made=calibration(width_us=40)).plan(asked).schedule


@pytest.mark.parametrize(
    "order", [("strength_duration", "power_law"), ("power_law", "strength_duration")]
)
def test_laws_make_a_level_stronger_and_widen_a_current_and_no_more(order: tuple[str, ...]) -> None:
    made = calibration(shape=Shape(strength_duration=NARROW))
    (level,) = narrowing(*order, made=made).plan(frame(level=LEVELS)).schedule
    asked = frame(current_ua=currents(e0=2_000), width_us=50, rate_hz=10.0)
    (current,) = narrowing(*order, made=made).plan(asked).schedule
    assert (level.current_ua, current.current_ua) == (2_000, 2_000)
    assert level.bounds.current_ua == 5_208
    assert (current.bounds.current_ua, current.bounds.width_us) == (2_000, 200)


def test_levels_are_clamped_as_they_are_narrowed_and_currents_as_they_are() -> None:
    made = calibration(shape=Shape(strength_duration=NARROW))
    (clamp,) = narrowing("strength_duration", made=made).plan(frame(level=LEVELS)).clamped
    assert (clamp.reason, clamp.wanted_ua, clamp.allowed_ua) == ("cap", 3_436, 3_000)
    (clamp,) = (
        narrowing("strength_duration", made=made)
        .plan(frame(current_ua=currents(e0=3_001), width_us=50))
        .clamped
    )
    assert (clamp.reason, clamp.wanted_ua, clamp.allowed_ua) == ("cap", 3_001, 3_000)
