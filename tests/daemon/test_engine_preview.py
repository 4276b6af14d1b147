"""Caps against prepulses: what is fired is within the cap, uses it, and is what was announced."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_parts import array, body_site, maxima_with
from engine_parts import calibration as calibrated
from engine_rig import EngineRig
from engine_scenes import calibration, clamps, config, only, open_calibrated, opened_to, phases
from etd.planning.headroom import Headroom, PlanRules
from etd.protocol.calibration import Calibration
from etd.pulse.request import NO_GAIN, PulseRequest
from etd.safety.limits import Path, PersonLimits, clamp_to_limits
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings
from etd.stabilize.strength_duration import StrengthDuration
from plain_records import changed
from trace_decoder import visits

pytestmark = pytest.mark.slow

N, ELECTRODE = 16, 3
STEP_UA = 10_000 / 4_095
HIGH_UA = 8_000
PROBE_UA = 300
prepulses = st.builds(Prepulse, below_db=st.floats(2.0, 10.0), width_us=st.integers(20, 90))
narrows = st.builds(StrengthDuration, width_us=st.integers(30, 100), tau_us=st.just(151.0))


def table(
    prepulse: Prepulse | None, narrow: StrengthDuration | None, is_probe_first: bool
) -> Settings:
    named = {"strength_duration": narrow, "prepulse": prepulse}
    laws: dict[str, Any] = {name: narrow for name, narrow in named.items() if narrow is not None}
    return Settings(order=tuple(laws), probe_first=is_probe_first, **laws)  # type: ignore[arg-type]


def accepted_pc(cap_ua: int, width_us: int, prepulse: Prepulse | None) -> int:
    """The charge of the pulse that somebody accepted, by hand."""
    led_pc = 0 if prepulse is None else int(cap_ua * prepulse.part) * prepulse.width_us
    return cap_ua * width_us + led_pc


def rules(prepulse: Prepulse | None, made: Calibration | None) -> PlanRules:
    site = msgspec.structs.replace(body_site(), stabilize=table(prepulse, None, False))
    person = PersonLimits((HIGH_UA,) * N, 200, 200 if made is None else made.width_us, made)
    return PlanRules(array(), site, maxima_with(), person, STEP_UA, NO_GAIN)


@given(
    prepulse=st.none() | prepulses,
    is_calibrated=st.booleans(),
    cap_ua=st.integers(50, 3_000),
    wanted_ua=st.integers(1, 6_000),
    own_us=st.integers(20, 150),
    wider=st.floats(0.3, 1.8),
)
def test_a_cap_lets_through_the_charge_that_was_accepted_and_all_of_it(
    prepulse: Prepulse | None,
    is_calibrated: bool,
    cap_ua: int,
    wanted_ua: int,
    own_us: int,
    wider: float,
) -> None:
    made = calibrated(shape=table(prepulse, None, False).shape) if is_calibrated else None
    headroom = Headroom(rules(prepulse, made))
    bounds = changed(
        headroom.bounds(
            wanted_ua, headroom.kind(own_us, (True,), 1.0, 1, None, is_level=is_calibrated)
        ),
        current_ua=HIGH_UA,
        charge_pc=HIGH_UA * 200,
    )
    pulse_request = PulseRequest(wanted_ua, max(20, int(own_us * wider)))
    pulse_request = pulse_request if prepulse is None else prepulse.of(pulse_request)
    free = maxima_with(charge_pc=2_000_000)
    path = Path(ELECTRODE, cap_ua, 15.0 * HIGH_UA, 9)
    allowed_ua, clamp = clamp_to_limits(path, pulse_request, free, HIGH_UA, None, False, bounds)
    cap_us = own_us if made is None else min(own_us, made.width_us)
    most_pc = accepted_pc(cap_ua, cap_us, prepulse if is_calibrated else None)
    assert allowed_ua <= min(cap_ua, wanted_ua)
    assert pulse_request.at(allowed_ua).charge_pc <= most_pc
    if clamp is None:
        assert allowed_ua == wanted_ua
    else:
        assert (
            allowed_ua == cap_ua
            or pulse_request.at(allowed_ua + 1).charge_pc > most_pc - pulse_request.prepulse_us
        )


# --- announced, and fired -----------------------------------------------------------------------


@settings(
    deadline=None,
    max_examples=25,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(
    prepulse=st.none() | prepulses,
    strength_duration=st.none() | narrows,
    is_probe_first=st.booleans(),
    is_calibrated=st.booleans(),
    cap_ua=st.integers(400, 2_000),
    wanted_ua=st.integers(400, 3_000),
    width_us=st.integers(40, 100),
)
def test_what_is_announced_as_clamped_is_what_is_fired(
    prepulse: Prepulse | None,
    strength_duration: StrengthDuration | None,
    is_probe_first: bool,
    is_calibrated: bool,
    cap_ua: int,
    wanted_ua: int,
    width_us: int,
) -> None:
    rig = opened(
        table(prepulse, strength_duration, is_probe_first),
        cap_ua,
        width_us if is_calibrated else None,
    )
    asked: dict[str, Any] = {"rate_hz": 20.0, "width_us": width_us}
    asked["current_ua"] = only(N, e3=wanted_ua)
    if strength_duration is not None and width_us > strength_duration.width_us:
        for is_strict in (False, True):
            assert rig.show(**asked, strict=is_strict).error == "bad_frame"
        if not is_calibrated:
            assert rig.close() == ()
            return
        del asked["current_ua"]
        asked["level"], wanted_ua = only(N, e3=1), cap_ua // 2
    refusal = rig.show(**asked, strict=True, ttl_ms=20)
    rig.run_ms(100)
    since_ns, told = rig.clock.now_ns(), len(clamps(rig))
    answer = rig.show(**asked, pulses=1)
    assert answer.error is None, answer.reason
    rig.run_ms(120)
    assert (refusal.error == "over_limit") == bool(answer.clamped)
    assert clamps(rig)[told:] == list(answer.clamped)
    (fired,) = [visit for visit in visits(phases(rig, since_ns)) if visit[0].electrode == ELECTRODE]
    if answer.clamped:
        allowed_ua = answer.clamped[0].allowed_ua
    else:
        allowed_ua = (
            wanted_ua
            if strength_duration is None
            else strength_duration.of(PulseRequest(wanted_ua, width_us)).current_ua
        )
    # No probe goes before a pulse that is as weak as one.
    *before, pulse = fired[1:] if is_probe_first and allowed_ua > PROBE_UA else fired
    assert allowed_ua - STEP_UA <= pulse.current_ua <= allowed_ua
    assert pulse.current_ua <= cap_ua
    led = prepulse if is_calibrated else None
    charge_pc = sum(phase.charge_pc for phase in before) + pulse.charge_pc
    assert charge_pc <= accepted_pc(cap_ua, width_us, led) + 1.0
    assert rig.close() == ()


def opened(table_: Settings, cap_ua: int, calibrated_us: int | None) -> EngineRig:
    """Armed, under caps that this shape has, with the opening wide."""
    loaded = config(electrodes=N)
    site = msgspec.structs.replace(loaded.body_site, stabilize=table_)
    rig = engine_rig.make(loaded=dataclasses.replace(loaded, body_site=site))
    if calibrated_us is not None:
        made = calibration(
            rig, (cap_ua,) * N, shape=table_.shape, width_us=calibrated_us, rate_hz=20.0
        )
        assert open_calibrated(rig, made).error is None
    else:
        rig.open(max_current_ua=cap_ua, width_us=190)
    rig.arm()
    # Up to the highest that any bound but the opening lets through.
    opened_to(rig, 6_500)
    rig.hold(1_300, current_ua=only(N, e0=20), rate_hz=20.0, width_us=20)
    return rig
