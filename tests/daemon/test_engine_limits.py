"""Limits on the wires: caps, returns, ledger, and whatever a stabilizer asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from engine_rig import EngineRig
from engine_scenes import (
    MS,
    calibration,
    clamps,
    config,
    felt_ua,
    fully_open,
    only,
    open_calibrated,
    opened_to,
    phases,
    shortfalls,
)
from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
STEP_UA = 10_000 / 4_095


def caps(**only_ua: int) -> list[int]:
    """4 mA everywhere but at the named electrodes."""
    changed = {int(name[1:]): value for name, value in only_ua.items()}
    return [changed.get(electrode, 4_000) for electrode in range(N)]


def calibrated(rig: EngineRig, caps_ua: list[int], open_ua: int = 3_000) -> EngineRig:
    """Armed with these caps, the opening wide enough."""
    assert open_calibrated(rig, calibration(rig, caps_ua)).error is None
    rig.arm()
    opened_to(rig, open_ua)
    rig.hold(open_ua // 5 + 30, current_ua=only(N, e0=10), rate_hz=20.0)
    return rig


def test_an_electrode_never_gets_more_than_its_own_cap(make_rig: MakeRig) -> None:
    rig = calibrated(make_rig(electrodes=N), caps(e3=700))
    answer = rig.show(current_ua=only(N, e3=2_000, e4=2_000))
    assert [(clamp.electrode, clamp.allowed_ua, clamp.reason) for clamp in answer.clamped] == [
        (3, 700, "cap")
    ]
    rig.run_ms(60)
    felt = felt_ua(rig)
    assert 700 - STEP_UA < felt[3] <= 700
    assert 2_000 - STEP_UA < felt[4] <= 2_000
    told = [clamp for clamp in clamps(rig) if clamp.reason == "cap"]
    assert {
        (clamp.electrode, clamp.wanted_ua, clamp.allowed_ua, clamp.limited_by) for clamp in told
    } == {(3, 2_000, 700, 3)}


@pytest.mark.parametrize("width_us", [40, 100, 130, 160])
def test_a_cap_is_of_the_charge_that_it_has_in_the_pulses_it_was_accepted_with(
    make_rig: MakeRig, width_us: int
) -> None:
    """They were of 100 us: a wider pulse of the same current would be felt as more."""
    cap_ua = 2_000
    rig = calibrated(make_rig(electrodes=N), caps(e3=cap_ua))
    allowed_ua = cap_ua * min(width_us, 100) // width_us
    asked = {"current_ua": only(N, e3=cap_ua), "width_us": width_us}
    answer = rig.show(**asked)
    told = [
        (clamp.electrode, clamp.wanted_ua, clamp.allowed_ua, clamp.reason)
        for clamp in answer.clamped
    ]
    assert told == ([] if width_us <= 100 else [(3, cap_ua, allowed_ua, "cap")])
    rig.run_ms(60)
    assert allowed_ua - STEP_UA < felt_ua(rig)[3] <= allowed_ua
    is_refused = rig.show(**asked, strict=True).error == "over_limit"
    assert is_refused == (width_us > 100)


def test_the_cap_of_a_return_is_of_its_charge_too(make_rig: MakeRig) -> None:
    rig = make_rig(loaded=config("feetthrough-relay", N))
    calibrated(rig, caps(e4=600))
    sets = tuple((0,) if electrode == 4 else (4,) for electrode in range(N))
    answer = rig.show(
        current_ua=only(N, e3=600), width_us=150, returns=sets, pulses=1, rate_hz=10.0
    )
    assert [(clamp.allowed_ua, clamp.reason, clamp.limited_by) for clamp in answer.clamped] == [
        (400, "return_cap", 4)
    ]


def test_a_level_is_felt_between_threshold_and_comfortable(make_rig: MakeRig) -> None:
    rig = calibrated(make_rig(electrodes=N), caps())
    since_ns = rig.clock.now_ns()
    rig.show(level=tuple(1.0 if electrode == 5 else 0.0 for electrode in range(N)))
    rig.run_ms(30)
    assert felt_ua(rig, since_ns) == {5: pytest.approx(2_000, abs=STEP_UA)}


def on_skin(rig: EngineRig, electrodes: int) -> None:
    """So many electrodes on the skin, and the others in the air."""
    for electrode in range(electrodes, N):
        rig.fake.world.lift(electrode)


@pytest.mark.parametrize(("touching", "allowed_ua"), [(16, 1_500), (8, 700)])
def test_through_all_others_a_weak_return_counts_by_the_share_it_may_carry(
    make_rig: MakeRig, touching: int, allowed_ua: int
) -> None:
    rig = make_rig(electrodes=N)
    on_skin(rig, touching)
    calibrated(rig, caps(e3=100))
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e5=3_000), pulses=2, rate_hz=20.0)
    rig.run_ms(40)
    # By probes of 100 uA, which the ADC reads in some thirty steps, and a frame of 10 uA.
    assert 0.75 * allowed_ua < felt_ua(rig, since_ns)[5] <= allowed_ua
    told = [
        clamp for clamp in clamps(rig) if clamp.reason == "return_cap" and clamp.wanted_ua == 3_000
    ]
    assert {(clamp.electrode, clamp.limited_by) for clamp in told} == {(5, 3)}
    assert max(clamp.allowed_ua for clamp in told) - STEP_UA <= felt_ua(rig, since_ns)[5]


def test_a_weak_return_that_is_left_alone_is_spared_within_a_second(make_rig: MakeRig) -> None:
    rig = calibrated(make_rig(electrodes=N), caps(e3=1_000))
    rig.hold(1_500, current_ua=only(N, e5=3_000), rate_hz=20.0)
    for electrode in set(range(N)) - {3, 5}:
        rig.fake.world.lift(electrode)
    rig.hold(1_000, current_ua=only(N, e5=3_000), rate_hz=20.0)
    since_ns = rig.clock.now_ns()
    rig.hold(500, current_ua=only(N, e5=3_000), rate_hz=20.0)
    fired_ua = [phase.current_ua for phase in phases(rig, since_ns) if phase.electrode == 5]
    assert len(fired_ua) == 10
    assert max(fired_ua) <= 1_000
    assert {clamp.limited_by for clamp in clamps(rig) if clamp.reason == "return_cap"} == {3}


def test_one_electrode_alone_gets_what_it_wants_as_long_as_the_others_touch(
    make_rig: MakeRig,
) -> None:
    """Where it would get less for want of looks, silent electrodes are asked with probes."""
    rig = calibrated(make_rig(electrodes=N), caps(e3=1_000))
    rig.hold(1_200, current_ua=only(N, e5=3_000), rate_hz=30.0)
    since_ns = rig.clock.now_ns()
    rig.hold(5_000, current_ua=only(N, e5=3_000), rate_hz=30.0)
    mine = [phase for phase in phases(rig, since_ns) if phase.electrode == 5]
    others = [phase for phase in phases(rig, since_ns) if phase.electrode != 5]
    assert min(phase.current_ua for phase in mine) == pytest.approx(3_000, abs=STEP_UA)
    assert max(phase.current_ua for phase in others) <= 300
    assert {phase.electrode for phase in others} == set(range(N)) - {5}
    assert rig.engine.components.reporter.counters["contact_polls"] == len(
        [phase for phase in phases(rig) if phase.scan is not None and 200 < phase.current_ua < 400]
    )


def test_where_nothing_would_be_taken_away_silent_electrodes_stay_silent(
    make_rig: MakeRig,
) -> None:
    rig = calibrated(make_rig(electrodes=N), caps())
    since_ns = rig.clock.now_ns()
    rig.hold(5_000, current_ua=only(N, e5=3_000), rate_hz=30.0)
    assert {phase.electrode for phase in phases(rig, since_ns)} == {5}


def test_in_an_explicit_set_the_weakest_return_caps_as_if_it_were_alone(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(loaded=config("feetthrough-relay", 16))
    calibrated(rig, caps(e3=600))
    since_ns = rig.clock.now_ns()
    sets = ((3, 4), *((0,),) * 15)
    answer = rig.show(current_ua=only(N, e0=900), returns=sets, pulses=1, rate_hz=10.0)
    assert [(clamp.allowed_ua, clamp.limited_by) for clamp in answer.clamped] == [(600, 3)]
    rig.run_ms(40)
    (phase,) = phases(rig, since_ns)
    assert phase.current_ua == pytest.approx(600, abs=STEP_UA)
    assert phase.source == {0}
    assert phase.ground == {3, 4}


def test_strict_is_refused_instead_of_clamped_and_nothing_is_felt(make_rig: MakeRig) -> None:
    rig = calibrated(make_rig(electrodes=N), caps(e3=700))
    rig.run_ms(250)
    since_ns = rig.clock.now_ns()
    answer = rig.show(current_ua=only(N, e3=2_000), strict=True)
    assert (answer.error, answer.electrode) == ("over_limit", 3)
    rig.run_ms(50)
    assert phases(rig, since_ns) == []


# --- ledger ---------------------------------------------------------------------------------------


def test_a_pulse_that_does_not_fit_the_ledger_is_not_fired_and_is_told(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=config(maxima={"on_us_per_s": 2_000})), 1_000)
    rig.run_ms(1_100 - 230)
    since_ns = rig.clock.now_ns()
    rig.hold(900, current_ua=only(N, e5=500), width_us=100, rate_hz=100.0)
    fired = [phase for phase in phases(rig, since_ns) if phase.electrode == 5]
    assert len(fired) == 20
    told = [shortfall for shortfall in shortfalls(rig) if shortfall.reason == "ledger"]
    assert {shortfall.electrode for shortfall in told} == {5}
    assert sum(shortfall.pulses for shortfall in told) > 60


def test_the_window_of_the_ledger_goes_on_across_frames_and_leases(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=config(maxima={"on_us_per_s": 2_000})), 1_000)
    rig.hold(400, current_ua=only(N, e5=500), width_us=100, rate_hz=100.0)
    since_ns = rig.clock.now_ns()
    rig.hold(300, current_ua=only(N, e5=400), width_us=90, rate_hz=100.0)
    fired = [phase for phase in phases(rig, since_ns) if phase.electrode == 5]
    assert fired == []


def test_the_charge_that_an_electrode_gets_in_any_second_is_within_its_mean_current(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(loaded=config(maxima={"mean_current_ua": 4})), 1_000)
    for width_us, rate_hz in ((100, 40.0), (50, 79.0), (99, 39.0)):
        rig.hold(500, current_ua=only(N, e5=1_000), width_us=width_us, rate_hz=rate_hz)
    fired = [phase for phase in phases(rig) if phase.electrode == 5]
    for last in fired:
        second = [phase for phase in fired if 0 <= last.from_ns - phase.from_ns < 1_000 * MS]
        assert sum(phase.charge_pc for phase in second) <= 4_000_000


# --- stabilizers ----------------------------------------------------------------------------------


@dataclass
class Times:
    """Wishes for a multiple of what it is given, and for a longer pulse."""

    factor: float
    width_us: int = 200

    @property
    def max_gain(self) -> MaxGain:
        return MaxGain(self.factor, 2.0, 2 * self.factor)

    def reset(self) -> None:
        pass

    def adapt(self, pulse_request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        assert estimate.electrode in range(N)
        return PulseRequest(int(pulse_request.current_ua * self.factor), self.width_us)


def test_stabilizers_ask_one_after_another(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N, stabilizers=[Times(2), Times(1, 60)])
    calibrated(rig, caps(e3=3_000), 4_000)
    since_ns = rig.clock.now_ns()
    rig.hold(3_000, level=only(N, e3=1))
    last = [phase for phase in phases(rig, since_ns) if phase.electrode == 3][-1]
    assert last.width_us == pytest.approx(60, abs=2)


def test_whatever_a_stabilizer_asks_for_the_limits_have_the_last_word(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N, stabilizers=[Times(50)])
    calibrated(rig, caps(e3=700), 4_000)
    since_ns = rig.clock.now_ns()
    rig.show(level=only(N, e3=1, e4=1))
    rig.run_ms(60)
    felt = felt_ua(rig, since_ns)
    # Twice as wide as the frame's: the caps let through the charge that they have at its width.
    assert felt[3] == pytest.approx(350, abs=STEP_UA)
    assert felt[4] == pytest.approx(2_000, abs=STEP_UA + 60)
    assert 190 < max(phase.width_us for phase in phases(rig, since_ns)) <= 200


def test_whatever_a_stabilizer_asks_for_a_current_that_is_named_is_never_passed(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(electrodes=N, stabilizers=[Times(50)])
    calibrated(rig, caps(), 2_000)
    since_ns, told = rig.clock.now_ns(), len(clamps(rig))
    rig.show(current_ua=only(N, e3=100, e4=500), width_us=100)
    rig.run_ms(60)
    felt = felt_ua(rig, since_ns)
    assert felt[3] == pytest.approx(100, abs=STEP_UA)
    assert felt[4] == pytest.approx(500, abs=STEP_UA)
    assert 190 < max(phase.width_us for phase in phases(rig, since_ns)) <= 200
    assert {clamp.reason for clamp in clamps(rig)[told:]} == {"frame"}


def test_no_stabilizer_widens_a_pulse_beyond_the_width_that_a_person_is_limited_to(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(electrodes=N, stabilizers=[Times(1)])
    rig.open(width_us=120)
    rig.arm()
    since_ns = rig.clock.now_ns()
    rig.hold(200, current_ua=only(N, e4=300), width_us=80)
    assert 119 < max(phase.width_us for phase in phases(rig, since_ns)) <= 120


def test_a_stabilizer_may_ask_for_less(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N, stabilizers=[Times(0.5, 60)])
    fully_open(rig, 1_000)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e4=900), width_us=100)
    rig.run_ms(60)
    assert felt_ua(rig, since_ns)[4] == pytest.approx(450, abs=STEP_UA)
    assert max(phase.width_us for phase in phases(rig, since_ns)) <= 60
    assert not [clamp for clamp in clamps(rig) if clamp.electrode == 4]


def test_a_stabilizer_that_asks_for_nothing_is_silence(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N, stabilizers=[Times(0)])
    fully_open(rig, 500)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e4=900))
    rig.run_ms(60)
    assert phases(rig, since_ns) == []
