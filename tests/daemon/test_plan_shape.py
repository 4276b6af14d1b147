"""A calibration and a body site that makes other pulses than it was made with: what is refused."""

from __future__ import annotations

import msgspec
import pytest

from engine_parts import body_site, calibration, currents, frame, planner
from etd.errors import Refused
from etd.stabilize.bursts import Bursts
from etd.stabilize.narrow import Narrow
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings

LEVELS = (1.0,) + (0.0,) * 15


def test_levels_of_plain_pulses_are_refused_where_the_site_makes_others_of_them() -> None:
    prepulse = Prepulse(below_db=6.0, width_us=50)
    settings = Settings(order=("prepulse",), prepulse=prepulse, probe_first=True)
    site = msgspec.structs.replace(body_site(), stabilize=settings)
    with pytest.raises(Refused, match="makes a prepulse of 50 us, 6 dB below, a probe before each"):
        planner(calibrated=calibration(), site=site).plan(frame(level=LEVELS))

    led_into = calibration(shape=settings.shape)
    assert planner(calibrated=led_into, site=site).plan(frame(level=LEVELS)).visits
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
        assert not planner(calibrated=made, site=here).plan(silent).visits
    of_this_shape = calibration(shape=settings.shape)
    assert planner(calibrated=of_this_shape, site=site).plan(asked).visits
    assert planner(site=site).plan(asked).visits, "limits are of no calibration"


def test_caps_hold_for_narrower_pulses_of_no_more_current() -> None:
    narrow = Settings(order=("narrow",), narrow=Narrow(width_us=50, tau_us=151.0))
    site = msgspec.structs.replace(body_site(), stabilize=narrow)
    assert narrow.narrow is not None
    made = planner(calibrated=calibration(), site=site, reach=narrow.narrow.reach)
    assert made.plan(frame(current_ua=currents(e0=500))).visits
    (clamp,) = made.plan(frame(current_ua=currents(e0=2_900))).clamped
    assert (clamp.reason, clamp.got_ua) == ("cap", 3_000)
