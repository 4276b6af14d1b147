"""The brake follows what the kernel says of the scan's core, on plans and scans, while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest

from engine_rig import EngineRig
from engine_scenes import MS, fully_open, states
from etd.files.configuration import fake_config
from etd_hal.bench import UNKNOWN_CORE, ScanCore
from etd_hal.fake.machines import PI4
from etd_hal.fake.processor import StagedTime

MakeRig = Callable[..., EngineRig]
ALONE = ScanCore(3, is_isolated=True, has_throttle=False, has_fair_server=False)
THROTTLED = ScanCore(3, is_isolated=True, has_throttle=True, has_fair_server=False)
DENSE = {"current_ua": (400,) * 64, "rate_hz": 100.0, "allow_slower": True, "ttl_ms": 1_000}


def alone_rig(make_rig: MakeRig, core: ScanCore = ALONE) -> EngineRig:
    loaded = fake_config("kajimoto-hv507", electrodes=64)
    # After which nothing is slept in a rest.
    board = msgspec.structs.replace(loaded.board, rest_us=50)
    rig = make_rig(loaded=replace(loaded, board=board))
    rig.fake.world.host.modelled_core = core
    return fully_open(rig, 500)


@pytest.mark.parametrize(("core", "most"), [(ALONE, 98), (THROTTLED, 80), (UNKNOWN_CORE, 80)])
def test_status_says_what_the_scan_may_take_and_why(
    make_rig: MakeRig, core: ScanCore, most: int
) -> None:
    rig = alone_rig(make_rig, core)
    rig.run_ms(1_500)
    told = states(rig)[-1].busy_at_most
    assert told.startswith(f"the scan takes at most {most} % of any 100 ms ({core}")
    assert ("docs/install.md" in told) is (most == 80)


def planned_hz(rig: EngineRig) -> float:
    answer = rig.show(**DENSE)
    assert answer.rate_hz is not None, answer
    found = answer.rate_hz
    rig.run_ms(900)
    return found


def test_a_throttle_that_is_switched_on_while_it_runs_slows_plans_and_scans_within_a_second(
    make_rig: MakeRig,
) -> None:
    rig = alone_rig(make_rig)
    free_hz = planned_hz(rig)
    rig.fake.world.host.modelled_core = THROTTLED
    since_ns = rig.clock.now_ns()
    rig.hold(400, **DENSE)
    told = [state for state in states(rig) if state.now_ns > since_ns]
    assert "at most 80 %" in told[-1].busy_at_most
    assert told[-1].now_ns - since_ns < 350 * MS
    held_hz = planned_hz(rig)
    assert held_hz < 0.95 * free_hz
    rig.fake.world.host.modelled_core = ALONE
    rig.hold(400, **DENSE)
    assert planned_hz(rig) > 1.05 * held_hz


def test_a_sensors_process_that_hangs_closes_the_brake(make_rig: MakeRig) -> None:
    rig = alone_rig(make_rig)
    rig.run_ms(300)
    assert rig.engine.components.clock.busy_fraction > 0.9
    rig.is_sensing = False
    rig.run_ms(600)
    assert rig.engine.components.clock.busy_fraction == 0.8
    assert "it was not read" in states(rig)[-1].busy_at_most


@pytest.mark.parametrize(
    ("late_us", "spun_us", "is_counted"), [(10, 14.5, False), (60, 50.0, True)]
)
def test_status_says_what_of_a_sleep_is_spun_and_how_many_wake_ups_were_later(
    make_rig: MakeRig, late_us: int, spun_us: float, is_counted: bool
) -> None:
    machine = replace(PI4, wake_late_ns=late_us * 1_000)
    rig = make_rig("kajimoto-hv507", electrodes=64, processor=StagedTime(1.0), machine=machine)
    fully_open(rig, 500)
    rig.hold(300, **DENSE)
    rig.run_ms(1_000)
    last = states(rig)[-1]
    assert last.timing["spun_us"] == spun_us
    assert ("wakeups_late" in last.counters) is is_counted
