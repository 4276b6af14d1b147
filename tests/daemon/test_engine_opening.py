"""The opening and the re-contact ramp, seen on the wires."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import (
    MS,
    armed,
    clamps,
    felt_ua,
    fully_open,
    only,
    phases,
    scans,
    states,
)
from etd.link import ArmBoard, ClearHalt, CloseLease, DisarmBoard, StopNow
from etd_body.electrode import skin
from etd_hal.fake.faults import SpiError

MakeRig = Callable[..., EngineRig]
N = 16
ALL = (3_000,) * N
STEP_UA = 10_000 / 4_095


def test_after_arming_the_current_starts_at_zero_and_rises_half_a_milliampere_in_100_ms(
    make_rig: MakeRig,
) -> None:
    rig = armed(make_rig(electrodes=N))
    from_ns = rig.clock.now_ns()
    rig.hold(700, current_ua=only(N, e3=3_000), rate_hz=50.0)
    fired = phases(rig, from_ns)
    first_ns = fired[0].from_ns
    assert first_ns - from_ns < 30 * MS
    for one in fired:
        allowed_ua = min(3_000, (one.from_ns - from_ns) * 500 / (100 * MS))
        assert allowed_ua - 151 < one.current_ua <= allowed_ua
    assert fired[-1].current_ua == pytest.approx(3_000, abs=STEP_UA)


def test_electrodes_switch_freely_below_the_ceiling(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e12=900))
    rig.run_ms(20)
    assert felt_ua(rig, since_ns)[12] == pytest.approx(900, abs=STEP_UA)


def test_the_ceiling_holds_while_no_frame_stands(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.run_ms(250)
    ceiling_ua = rig.engine.opening.ceiling_ua
    assert rig.engine.scanner.standing is None
    rig.run_ms(500)
    assert rig.engine.opening.ceiling_ua == ceiling_ua
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, rate_hz=60.0)
    rig.run_ms(15)
    assert max(felt_ua(rig, since_ns).values()) <= ceiling_ua + 100


def test_a_fall_is_never_delayed(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 2_500)
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
    rig.ask(StopNow, who="operator")
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
    rig = fully_open(make_rig(electrodes=N), 2_000)
    interlude(rig)
    assert rig.engine.opening.ceiling_ua == 0
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, rate_hz=60.0)
    rig.run_ms(100)
    assert max(felt_ua(rig, since_ns).values()) <= 500


def test_after_a_fault_it_starts_at_zero() -> None:
    rig = fully_open(engine_rig.make(electrodes=N), 2_000)
    fault_and_clear(rig)
    assert rig.engine.opening.ceiling_ua == 0
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
    told = [one for one in clamps(rig) if one.reason == "opening"]
    assert told
    assert {(one.electrode, one.wanted_ua) for one in told} == {(3, 2_000)}
    assert all(one.got_ua < 1_050 for one in told)
    assert 700 <= scans(rig)[-1].ceiling_ua <= 1_050
    assert states(rig)[-1].state == "ARMED"


# --- contact lost and found -----------------------------------------------------------------------


def test_a_lifted_electrode_gets_the_probe_bound_and_no_more(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 2_500)
    wanted = only(N, e3=2_000, e4=2_000)
    rig.hold(60, current_ua=wanted, rate_hz=50.0)
    rig.fake.world.lift(3)
    rig.run_ms(30)
    since_ns = rig.clock.now_ns()
    rig.hold(200, current_ua=wanted, rate_hz=50.0)
    felt = felt_ua(rig, since_ns)
    assert felt[3] <= 300
    assert felt[4] == pytest.approx(2_000, abs=STEP_UA)
    told = [one for one in clamps(rig) if one.reason == "contact_open"]
    assert {(one.electrode, one.got_ua) for one in told} == {(3, 300)}


def test_a_lifted_electrode_that_is_touched_again_ramps_alone(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 2_500)
    wanted = only(N, e3=2_000, e4=2_000)
    rig.hold(60, current_ua=wanted, rate_hz=50.0)
    rig.fake.world.lift(3)
    rig.hold(200, current_ua=wanted, rate_hz=50.0)
    touched_ns = rig.clock.now_ns()
    rig.fake.world.touch(3, skin())
    rig.hold(600, current_ua=wanted, rate_hz=50.0)
    again = [one for one in phases(rig, touched_ns) if one.electrode == 3]
    found_ns = again[0].from_ns
    for one in again[1:]:
        assert one.current_ua <= (one.from_ns - found_ns) * 500 / (100 * MS)
    assert again[-1].current_ua == pytest.approx(2_000, abs=STEP_UA)
    beside = [one for one in phases(rig, touched_ns) if one.electrode == 4]
    assert all(one.current_ua == pytest.approx(2_000, abs=STEP_UA) for one in beside)
    told = [one for one in clamps(rig) if one.reason == "recontact"]
    assert {one.electrode for one in told} == {3}


def test_an_electrode_that_was_open_at_arming_ramps_when_it_is_touched(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    rig.fake.world.lift(3)
    fully_open(rig, 2_000)
    since_ns = rig.clock.now_ns()
    rig.hold(100, current_ua=only(N, e3=2_000), rate_hz=50.0)
    assert felt_ua(rig, since_ns)[3] <= 300
    rig.fake.world.touch(3, skin())
    touched_ns = rig.clock.now_ns()
    rig.hold(100, current_ua=only(N, e3=2_000), rate_hz=50.0)
    assert felt_ua(rig, touched_ns)[3] <= 500
