"""The opening and the re-contact ramp, seen on the wires."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import msgspec
import pytest

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import (
    MS,
    armed,
    clamps,
    config,
    felt_ua,
    only,
    phases,
    scans,
    states,
)
from etd.protocol.link import ArmBoard, ClearHalt, CloseLease, DisarmBoard, StopNow
from etd.stabilize.bursts import Bursts
from etd.stabilize.settings import Settings
from etd_body.electrode import skin
from etd_hal.fake.faults import SpiError
from rise_witness import Rise
from trace_decoder import Phase

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
ALL = (3_000,) * N
STEP_UA = 10_000 / 4_095


def risen(rig: EngineRig, current_ua: int) -> EngineRig:
    """Armed, with pulses held until the opening has let `current_ua` through."""
    armed(rig)
    hold_ms = current_ua / 500 * 120 + 60
    rig.hold(hold_ms, current_ua=only(N, e0=current_ua), rate_hz=50.0)
    assert felt_ua(rig)[0] == pytest.approx(current_ua, abs=STEP_UA)
    return rig


def exceeding_ua(found: Sequence[Phase]) -> float:
    """By how much a pulse is above all that was fired 100 ms before it or earlier, at the most."""
    rise = Rise()
    return max(rise.above_ua(phase.from_ns, phase.current_ua) for phase in found)


def test_after_arming_the_current_starts_at_zero_and_rises_half_a_milliampere_in_100_ms(
    make_rig: MakeRig,
) -> None:
    rig = armed(make_rig(electrodes=N))
    from_ns = rig.clock.now_ns()
    rig.hold(800, current_ua=only(N, e3=3_000), rate_hz=50.0)
    fired = phases(rig, from_ns)
    first_ns = fired[0].from_ns
    assert first_ns - from_ns < 30 * MS
    for phase in fired:
        # A pulse every 20 ms: of the window, one period may be missing.
        most_ua = (phase.from_ns - from_ns) * 500 / (100 * MS)
        least_ua = (phase.from_ns - from_ns) * 500 / (120 * MS)
        assert min(2_997, least_ua - 151) < phase.current_ua <= min(3_000, most_ua)
    assert fired[-1].current_ua == pytest.approx(3_000, abs=STEP_UA)
    assert exceeding_ua(fired) <= 500


@pytest.mark.parametrize("silent_ua", [0, 3])
def test_frames_that_nobody_feels_open_nothing(make_rig: MakeRig, silent_ua: int) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.hold(1_700, current_ua=only(N, e0=silent_ua), rate_hz=50.0)
    since_ns = rig.clock.now_ns()
    rig.hold(110, current_ua=only(N, e3=3_000), rate_hz=50.0)
    within = [
        phase.current_ua for phase in phases(rig, since_ns) if phase.from_ns < since_ns + 100 * MS
    ]
    assert max(within) <= 500 + silent_ua


@pytest.mark.parametrize(
    ("rate_hz", "within_ms"), [(120.0, 700), (60.0, 750), (20.0, 1_100), (10.0, 1_350)]
)
def test_a_strong_frame_opens_to_3_ma_in_about_the_same_time_at_usual_rates(
    make_rig: MakeRig, rate_hz: float, within_ms: int
) -> None:
    rig = armed(make_rig(electrodes=N))
    from_ns = rig.clock.now_ns()
    rig.hold(within_ms, current_ua=only(N, e3=3_000), width_us=50, rate_hz=rate_hz)
    fired = phases(rig, from_ns)
    assert fired[-1].current_ua == pytest.approx(3_000, abs=STEP_UA)
    opened_ns = next(phase.from_ns for phase in fired if phase.current_ua > 2_990) - from_ns
    print(f"{rate_hz:g} Hz: 3 mA after {opened_ns / MS:.0f} ms")
    assert opened_ns >= 590 * MS
    assert exceeding_ua(fired) <= 500


def test_weak_pulses_open_half_a_milliampere_above_themselves(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    from_ns = rig.clock.now_ns()
    rig.hold(2_500, current_ua=only(N, e0=1_000), rate_hz=50.0)
    since_ns = rig.clock.now_ns()
    rig.hold(110, current_ua=only(N, e3=3_000), rate_hz=50.0)
    assert felt_ua(rig, since_ns)[3] == pytest.approx(1_500, abs=2 * STEP_UA)
    assert exceeding_ua(phases(rig, from_ns)) <= 500


def test_frames_of_one_pulse_open_as_others_do(make_rig: MakeRig) -> None:
    """Each stands until it has had its pulse, and no longer."""
    rig = armed(make_rig(electrodes=N))
    from_ns = rig.clock.now_ns()
    for _ in range(40):
        assert rig.show(current_ua=only(N, e3=2_000), pulses=1).error is None
        rig.run_ms(20)
    fired = phases(rig, from_ns)
    assert fired[-1].current_ua == pytest.approx(2_000, abs=STEP_UA)
    assert exceeding_ua(fired) <= 500


def test_bursts_open_as_other_frames_do(make_rig: MakeRig) -> None:
    loaded = config(electrodes=N)
    site = msgspec.structs.replace(
        loaded.body_site, stabilize=Settings(bursts=Bursts(pulses=3, rate_hz=200.0))
    )
    rig = armed(make_rig(loaded=dataclasses.replace(loaded, body_site=site)))
    from_ns = rig.clock.now_ns()
    rig.hold(900, current_ua=only(N, e3=2_000), width_us=50, rate_hz=20.0)
    fired = phases(rig, from_ns)
    assert fired[-1].current_ua == pytest.approx(2_000, abs=STEP_UA)
    assert exceeding_ua(fired) <= 500


def test_electrodes_switch_freely_below_the_ceiling(make_rig: MakeRig) -> None:
    rig = risen(make_rig(electrodes=N), 1_000)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e12=900))
    rig.run_ms(20)
    assert felt_ua(rig, since_ns)[12] == pytest.approx(900, abs=STEP_UA)


def test_a_pause_opens_no_more_than_the_next_half_milliampere(make_rig: MakeRig) -> None:
    rig = risen(make_rig(electrodes=N), 1_000)
    rig.run_ms(750)
    assert rig.engine.components.active.schedule is None
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, rate_hz=60.0)
    rig.run_ms(90)
    assert 1_000 <= max(felt_ua(rig, since_ns).values()) <= 1_500


def test_a_fall_is_never_delayed(make_rig: MakeRig) -> None:
    rig = risen(make_rig(electrodes=N), 2_500)
    rig.show(current_ua=only(N, e3=2_500), rate_hz=60.0)
    rig.run_ms(50)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=500), rate_hz=60.0)
    rig.run_ms(50)
    assert max(felt_ua(rig, since_ns + MS).values()) <= 500


def disarm(rig: EngineRig) -> None:
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    assert rig.ask(ArmBoard).error is None


def stop_and_clear(rig: EngineRig) -> None:
    rig.ask(StopNow, client="operator")
    rig.ask(ClearHalt)
    armed(rig)


def fault_and_clear(rig: EngineRig) -> None:
    rig.fake.world.put_in(SpiError())
    rig.show(current_ua=ALL)
    rig.run_ms(30)
    assert rig.state == "HALTED"
    rig.ask(ClearHalt)
    armed(rig)


def change_lease(rig: EngineRig) -> None:
    rig.ask(CloseLease, lease=LEASE)
    armed(rig)


@pytest.mark.parametrize("interlude", [disarm, stop_and_clear, change_lease])
def test_after_arming_a_halt_or_a_change_of_lease_it_starts_at_zero(
    make_rig: MakeRig, interlude: Callable[[EngineRig], None]
) -> None:
    rig = risen(make_rig(electrodes=N), 2_000)
    interlude(rig)
    assert rig.engine.components.soft_start.ceiling_ua == 0
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, rate_hz=60.0)
    rig.run_ms(100)
    assert max(felt_ua(rig, since_ns).values()) <= 500


def test_after_a_fault_it_starts_at_zero() -> None:
    rig = risen(engine_rig.make(electrodes=N), 2_000)
    fault_and_clear(rig)
    assert rig.engine.components.soft_start.ceiling_ua == 0
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, rate_hz=60.0)
    rig.run_ms(100)
    assert max(felt_ua(rig, since_ns).values()) <= 500
    assert rig.close() == ()


def test_what_the_opening_holds_back_is_told_with_electrode_wish_and_gift(
    make_rig: MakeRig,
) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.hold(200, current_ua=only(N, e3=2_000), rate_hz=50.0)
    told = [clamp for clamp in clamps(rig) if clamp.reason == "soft_start"]
    assert told
    assert {(clamp.electrode, clamp.wanted_ua) for clamp in told} == {(3, 2_000)}
    assert all(clamp.allowed_ua < 1_050 for clamp in told)
    assert 600 <= scans(rig)[-1].ceiling_ua <= 1_000
    assert states(rig)[-1].state == "ARMED"


# --- contact lost and found -----------------------------------------------------------------------


def test_a_lifted_electrode_gets_the_probe_bound_and_no_more(make_rig: MakeRig) -> None:
    rig = risen(make_rig(electrodes=N), 2_500)
    wanted = only(N, e3=2_000, e4=2_000)
    rig.hold(60, current_ua=wanted, rate_hz=50.0)
    rig.fake.world.lift(3)
    rig.run_ms(30)
    since_ns = rig.clock.now_ns()
    rig.hold(200, current_ua=wanted, rate_hz=50.0)
    felt = felt_ua(rig, since_ns)
    assert felt[3] <= 300
    assert felt[4] == pytest.approx(2_000, abs=STEP_UA)
    told = [clamp for clamp in clamps(rig) if clamp.reason == "contact_open"]
    assert {(clamp.electrode, clamp.allowed_ua) for clamp in told} == {(3, 300)}


def test_a_lifted_electrode_that_is_touched_again_ramps_alone(make_rig: MakeRig) -> None:
    rig = risen(make_rig(electrodes=N), 2_500)
    wanted = only(N, e3=2_000, e4=2_000)
    rig.hold(60, current_ua=wanted, rate_hz=50.0)
    rig.fake.world.lift(3)
    rig.hold(200, current_ua=wanted, rate_hz=50.0)
    touched_ns = rig.clock.now_ns()
    rig.fake.world.touch(3, skin())
    rig.hold(700, current_ua=wanted, rate_hz=50.0)
    again = [phase for phase in phases(rig, touched_ns) if phase.electrode == 3]
    found_ns = again[0].from_ns
    for other_phase in again[1:]:
        assert other_phase.current_ua <= (other_phase.from_ns - found_ns) * 500 / (100 * MS)
    assert exceeding_ua(again[1:]) <= 500
    assert again[-1].current_ua == pytest.approx(2_000, abs=STEP_UA)
    beside = [phase for phase in phases(rig, touched_ns) if phase.electrode == 4]
    assert all(phase.current_ua == pytest.approx(2_000, abs=STEP_UA) for phase in beside)
    told = [clamp for clamp in clamps(rig) if clamp.reason == "recontact"]
    assert {clamp.electrode for clamp in told} == {3}


def test_an_electrode_that_was_open_at_arming_ramps_when_it_is_touched(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    rig.fake.world.lift(3)
    risen(rig, 2_000)
    since_ns = rig.clock.now_ns()
    rig.hold(100, current_ua=only(N, e3=2_000), rate_hz=50.0)
    assert felt_ua(rig, since_ns)[3] <= 300
    rig.fake.world.touch(3, skin())
    touched_ns = rig.clock.now_ns()
    rig.hold(100, current_ua=only(N, e3=2_000), rate_hz=50.0)
    assert felt_ua(rig, touched_ns)[3] <= 500


def test_an_electrode_that_is_touched_again_is_not_opened_by_what_it_does_not_get(
    make_rig: MakeRig,
) -> None:
    rig = risen(make_rig(electrodes=N), 2_500)
    rig.fake.world.lift(3)
    rig.hold(100, current_ua=only(N, e3=2_000, e4=2_000), rate_hz=50.0)
    rig.fake.world.touch(3, skin())
    rig.hold(2_000, current_ua=only(N, e3=300, e4=2_000), rate_hz=50.0)
    since_ns = rig.clock.now_ns()
    rig.hold(90, current_ua=only(N, e3=2_000, e4=2_000), rate_hz=50.0)
    assert felt_ua(rig, since_ns)[3] <= 800


def test_a_contact_that_was_made_anew_does_not_weaken_the_probes_of_the_next_arming(
    make_rig: MakeRig,
) -> None:
    """Its own ramp ends with the silence: a probe of nothing would leave the contact unknown."""
    rig = risen(make_rig(electrodes=N), 1_000)
    wanted = only(N, e3=900, e4=900)
    rig.fake.world.lift(3)
    rig.hold(100, current_ua=wanted, rate_hz=50.0)
    rig.fake.world.touch(3, skin())
    # Until its first pulse has told so, and no longer.
    rig.hold(20, current_ua=wanted, rate_hz=50.0)
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    since_ns = rig.clock.now_ns()
    assert rig.ask(ArmBoard).error is None
    probes_ua = {phase.electrode: phase.current_ua for phase in phases(rig, since_ns)}
    assert probes_ua == dict.fromkeys(range(N), pytest.approx(300, abs=STEP_UA))
