"""Prepulses, from the body-site file to the wires: planned, limited, booked, shown."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import msgspec
import pytest

from engine_parts import array, body_site, currents, frame, planner
from engine_rig import EngineRig
from engine_scenes import calibration, clamps, config, only, open_calibrated, opened_to, phases
from etd.files.body_site import BodySite, check_body_site
from etd.files.configuration import LoadedConfig
from etd.protocol.errors import Refused
from etd.pulse.request import NO_GAIN, MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings
from etd.stabilize.strength_duration import StrengthDuration
from etd_hal.errors import FileError
from trace_decoder import Phase, pulses
from trace_rules import violations

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
STEP_UA = 10_000 / 4_095
SIX_DB = Prepulse(below_db=6.0, width_us=60)
LEADING = Settings(order=("prepulse",), prepulse=SIX_DB)


def leading(site: BodySite, settings: Settings = LEADING, **maxima: int) -> BodySite:
    changed = msgspec.structs.replace(site.maxima, **maxima)
    return msgspec.structs.replace(site, stabilize=settings, maxima=changed)


def loaded_with(settings: Settings = LEADING, **maxima: int) -> LoadedConfig:
    loaded = config(electrodes=N)
    return dataclasses.replace(loaded, body_site=leading(loaded.body_site, settings, **maxima))


def opened(rig: EngineRig, current_ua: int) -> EngineRig:
    """Armed, with weak frames held, and the opening as high as `current_ua`."""
    rig.open(width_us=190)
    rig.arm()
    opened_to(rig, current_ua)
    rig.hold(current_ua // 5 + 30, current_ua=only(N, e0=20), rate_hz=20.0)
    return rig


def shown(rig: EngineRig, **fields: object) -> Sequence[tuple[Phase, ...]]:
    """The pulses of one frame, each with its prepulse."""
    since_ns = rig.clock.now_ns()
    assert rig.show(**fields).error is None
    rig.run_ms(60)
    return list(pulses(phases(rig, since_ns)))


# --- on the wires ---------------------------------------------------------------------------------


@pytest.mark.parametrize("polarity", ["anodic", "cathodic", "biphasic"])
def test_every_pulse_comes_in_two_steps_as_far_apart_as_the_site_says(
    make_rig: MakeRig, polarity: str
) -> None:
    rig = opened(make_rig(loaded=loaded_with()), 1_500)
    found = shown(rig, current_ua=only(N, e3=1_000, e9=600), width_us=80, polarity=polarity)
    assert {visit[0].electrode for visit in found} == {3, 9}
    for before, pulse in found:
        asked_ua = {3: 1_000, 9: 600}[pulse.electrode or 0]
        assert asked_ua - STEP_UA < pulse.current_ua <= asked_ua
        assert 0.501 * asked_ua - STEP_UA - 1 < before.current_ua <= 0.502 * asked_ua
        assert 59 < before.width_us <= 60
        assert 79 < pulse.width_us <= 80
        assert before.is_anodic == pulse.is_anodic


def test_narrow_pulses_may_have_prepulses_too(make_rig: MakeRig) -> None:
    narrow = StrengthDuration(width_us=60, tau_us=151.0)
    settings = Settings(
        order=("strength_duration", "prepulse"), strength_duration=narrow, prepulse=SIX_DB
    )
    rig = make_rig(loaded=loaded_with(settings))
    made = calibration(rig, (2_500,) * N, shape=settings.shape)
    assert open_calibrated(rig, made).error is None
    rig.arm()
    opened_to(rig, 2_500)
    rig.hold(530, current_ua=only(N, e0=20), width_us=60, rate_hz=20.0)
    found = shown(rig, level=only(N, e3=1), pulses=1)
    ((before, pulse),) = found
    rise = narrow.adapt(
        PulseRequest(1_250, 100), rig.engine.components.adapter.estimate(3, 0)
    ).current_ua
    assert 1_800 < rise < 1_900
    assert pulse.current_ua == pytest.approx(rise, abs=STEP_UA)
    assert pulse.width_us == pytest.approx(60, abs=1)
    assert before.current_ua == pytest.approx(rise / 2, abs=STEP_UA + 2)


def test_a_scan_with_prepulses_breaks_no_rule_and_ends_in_time(make_rig: MakeRig) -> None:
    rig = opened(make_rig(loaded=loaded_with()), 1_000)
    rig.hold(150, current_ua=(800,) * N, width_us=80)
    assert rig.engine.components.reporter.counters["not_fired_overrun"] == 0
    assert rig.close() == ()
    assert violations(rig.trace(), 200) == []


def test_two_steps_up_or_one_down_break_a_rule_of_the_wires(make_rig: MakeRig) -> None:
    rig = opened(make_rig(loaded=loaded_with()), 1_000)
    shown(rig, current_ua=only(N, e3=800), width_us=80)
    assert rig.close() == ()
    trace = rig.trace()
    steps = [
        place for place, entry in enumerate(trace) if entry.get("tx") not in (None, "", "0000")
    ]
    before, pulse = trace[steps[-3]]["tx"], trace[steps[-1]]["tx"]
    assert before < pulse
    for place, word in ((steps[-1], before), (steps[-1], "3ffc")):
        doctored = [dict(entry) for entry in trace]
        doctored[place]["tx"] = word
        assert any(
            "current steps from code" in violation for violation in violations(doctored, 200)
        )


@pytest.mark.parametrize(("width_us", "most"), [(100, 1.05), (36, 1.05), (25, 1.6)])
def test_what_the_skin_resists_is_told_by_the_pulse_and_never_seems_less(
    make_rig: MakeRig, width_us: int, most: float
) -> None:
    """Skin that does not begin at rest seems to resist more where a pulse has no end sample."""
    alone_settings = Settings(
        order=("strength_duration",), strength_duration=StrengthDuration(width_us=200, tau_us=151.0)
    )
    found = []
    for settings in (alone_settings, LEADING):
        rig = opened(make_rig(loaded=loaded_with(settings)), 1_000)
        rig.hold(100, current_ua=only(N, e3=800), width_us=width_us)
        found.append(rig.engine.components.adapter.estimate(3, rig.clock.now_ns()).skin_ohm)
    alone_ohm, led_ohm = found
    assert alone_ohm is not None
    assert led_ohm is not None
    assert 0.97 * alone_ohm <= led_ohm <= most * alone_ohm


@pytest.mark.parametrize("is_led", [False, True])
def test_a_time_constant_is_not_read_from_skin_that_does_not_begin_at_rest(
    make_rig: MakeRig, is_led: bool
) -> None:
    alone = Settings(
        order=("strength_duration",), strength_duration=StrengthDuration(width_us=200, tau_us=151.0)
    )
    rig = opened(make_rig(loaded=loaded_with(LEADING if is_led else alone)), 1_000)
    rig.hold(100, current_ua=only(N, e3=800), width_us=100)
    _, capacitance_nf = rig.engine.components.adapter.reported_ohm_nf(3, rig.clock.now_ns())
    assert (capacitance_nf is None) == is_led


# --- limits ---------------------------------------------------------------------------------------


def test_the_prepulse_falls_with_a_pulse_that_is_clamped(make_rig: MakeRig) -> None:
    rig = make_rig(loaded=loaded_with())
    rig.open(max_current_ua=600, width_us=190)
    rig.arm()
    rig.hold(200, current_ua=only(N, e0=20), rate_hz=20.0)
    found = shown(rig, current_ua=only(N, e3=1_000), width_us=80)
    told = [clamp for clamp in clamps(rig) if clamp.electrode == 3]
    assert told
    for before, pulse in found:
        assert pulse.current_ua <= told[-1].allowed_ua <= 600
        assert before.current_ua == pytest.approx(0.5 * pulse.current_ua, abs=2 * STEP_UA)
        charge_pc = before.charge_pc + pulse.charge_pc
        assert charge_pc <= 600 * 80


def test_the_ledger_counts_the_time_of_both_steps(make_rig: MakeRig) -> None:
    """140 us each: ten in a second."""
    rig = opened(make_rig(loaded=loaded_with(on_us_per_s=1_400)), 1_000)
    rig.run_ms(870)
    since_ns = rig.clock.now_ns()
    rig.hold(900, current_ua=only(N, e3=800), width_us=80)
    fired = [visit for visit in pulses(phases(rig, since_ns)) if visit[0].electrode == 3]
    assert len(fired) == 10


@dataclasses.dataclass(frozen=True)
class Asks:
    """A stabilizer that asks for a stronger prepulse than the plan has reckoned with."""

    request: PulseRequest
    max_gain: MaxGain = NO_GAIN

    def adapt(self, pulse_request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        return self.request

    def reset(self) -> None:
        """It remembers nothing."""


def test_the_ledger_counts_the_charge_of_both_steps(make_rig: MakeRig) -> None:
    """64 nC and 47 each: 35 in a second of at most 4 uC."""
    asks = Asks(PulseRequest(800, 80, 790, 60))
    rig = opened(make_rig(loaded=loaded_with(mean_current_ua=4), stabilizers=[asks]), 1_000)
    rig.run_ms(870)
    since_ns = rig.clock.now_ns()
    rig.hold(950, current_ua=only(N, e3=800), width_us=80, rate_hz=45.0)
    fired = [visit for visit in pulses(phases(rig, since_ns)) if visit[0].electrode == 3]
    assert len(fired) == 35
    assert sum(step.charge_pc for visit in fired for step in visit) <= 4_000_000


def test_a_prepulse_longer_than_the_site_leaves_room_for_is_cut_and_counted(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(loaded=loaded_with(), stabilizers=[Asks(PulseRequest(800, 80, 400, 90))])
    found = shown(opened(rig, 1_000), current_ua=only(N, e3=800), width_us=80)
    assert all(before.width_us <= 60 for before, _ in found)
    assert rig.engine.components.reporter.counters["width_requests_cut"] >= len(found)


def test_the_charge_of_both_steps_is_refused_above_the_maximum() -> None:
    """400 uA for 100 us and 200 uA for 60 us are 52 nC."""
    made = planner(site=leading(body_site(), charge_nc=52))
    assert made.plan(frame(current_ua=currents(e3=400), width_us=100)).schedule
    with pytest.raises(Refused, match="charge of a pulse"):
        made.plan(frame(current_ua=currents(e3=401), width_us=100))


def test_the_width_of_both_steps_is_refused_above_the_maximum() -> None:
    made = planner(site=leading(body_site()))
    assert made.plan(frame(current_ua=currents(e3=400), width_us=140)).schedule
    with pytest.raises(Refused, match="width 201 us"):
        made.plan(frame(current_ua=currents(e3=400), width_us=141))


def test_the_mean_current_is_that_of_both_steps() -> None:
    """2 mA times 130 us, 120 times a second: 31.2 uA."""
    made = planner(site=leading(body_site()))
    with pytest.raises(Refused, match=r"mean current 31\.2"):
        made.plan(frame(current_ua=currents(e3=2_000), width_us=100, rate_hz=120.0))


def test_a_slot_has_room_for_both_steps() -> None:
    asked = frame(current_ua=(300,) * 64, width_us=100, rate_hz=120.0, allow_slower=True)
    alone, led = (
        planner(site=site, layout=array("grid-8x8")).plan(asked)
        for site in (body_site(), leading(body_site()))
    )
    longer_us = (led.period_ns - alone.period_ns) / 1_000
    assert longer_us == pytest.approx(64 * 60, rel=0.01)


def test_what_the_guard_would_refuse_of_both_steps_is_refused_when_asked_for(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(loaded=loaded_with())
    widest_us = rig.engine.supervisor.maxima.width_us
    assert 180 < widest_us < 200
    assert any(str(widest_us) in limitation for limitation in rig.engine.supervisor.limitations)
    rig.open(width_us=widest_us)
    rig.arm()
    rig.hold(130, current_ua=only(N, e0=20), rate_hz=20.0)
    whole = {"current_ua": only(N, e3=400), "rate_hz": 20.0}
    assert rig.show(width_us=widest_us - 60 + 1, **whole).error == "over_maximum"
    found = shown(rig, width_us=widest_us - 60, pulses=1, **whole)
    assert len(found) == 1
    assert rig.state == "ARMED"


def test_a_default_width_that_leaves_no_room_for_a_prepulse_is_refused() -> None:
    with pytest.raises(FileError, match=r"defaults\.width_us: 160 is above maxima\.width_us"):
        check_body_site(leading(body_site(), width_us=150), "site.toml")
