"""Every fault is named at the stage where it can first be seen, and nobody gets more than the bound
meanwhile.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from etd_body.electrode import load
from etd_hal.fake.faults import (
    AdcScale,
    Bridge,
    DacGain,
    DacOffset,
    DacStuck,
    EnableStuck,
    Fault,
    HeartbeatIgnored,
    HeartbeatRearms,
    HeartbeatSlow,
    I2cFailure,
    LineCut,
    LostClock,
    MachineTrouble,
    MisoStuck,
    MonitorStuck,
    PullMissing,
    RailOff,
    RailStays,
    SetpointAtPowerUp,
    SlowWords,
    SpiError,
    SpiJitter,
    SpiMode,
    SpiShort,
    SpiStall,
    StopCutsNothing,
    StuckLine,
    SwitchOutput,
)
from selftest_rig import SelftestRig, bad, selftest_rig

ALL, BARE, RELAY = "reference-hv507", "kajimoto-hv507", "feetthrough-relay"


class Case(NamedTuple):
    """A fault on a board, and (stage, name) of the first check that must fail."""

    what: str
    board: str
    faults: Sequence[Fault]
    stage: str
    name: str
    how: dict[str, Any] = {}  # noqa: RUF012 - never changed


MACHINE = [
    Case("a Pi that is hot", ALL, [MachineTrouble("hot")], "machine", "temperature"),
    Case("throttled", ALL, [MachineTrouble("throttled")], "machine", "throttling"),
    Case("under-voltage", ALL, [MachineTrouble("under_voltage")], "machine", "supply_voltage"),
    Case("pins that stay", ALL, [MachineTrouble("pins_kept")], "machine", "pins_after_exit"),
    Case("no real time", ALL, [MachineTrouble("realtime_refused")], "machine", "realtime"),
    Case(
        "granted, but not scheduled", ALL, [MachineTrouble("not_scheduled")], "machine", "realtime"
    ),
    Case("granted, but not locked", ALL, [MachineTrouble("not_locked")], "machine", "realtime"),
    Case("locked in part", ALL, [MachineTrouble("partly_locked")], "machine", "realtime"),
    Case("hardly any memory", ALL, [MachineTrouble("little_memory")], "machine", "free_memory"),
    Case("a clock that goes back", ALL, [MachineTrouble("clock_back")], "machine", "clock"),
    Case("a coarse clock", ALL, [MachineTrouble("clock_coarse")], "machine", "clock"),
    Case("a date of 1970", ALL, [MachineTrouble("date_wrong")], "machine", "date"),
    Case("no gpiod", ALL, [MachineTrouble("package_missing")], "machine", "libraries"),
    Case("a Pi 5", ALL, [MachineTrouble("wrong_model")], "machine", "model"),
]
BUSES = [
    Case("MISO floats high", ALL, [MisoStuck(1)], "buses", "spi_echo"),
    Case("the DAC does not move", BARE, [DacStuck(200)], "buses", "idle_node"),
    Case("the source has an offset", BARE, [DacOffset(60.0)], "buses", "idle_node"),
    *(
        Case(f"{name} is stuck at {level}", ALL, [StuckLine(name, level)], "buses", "lines")
        for name in ("POL", "BL", "LE", "CLK", "DATA", "HEARTBEAT", "SYNC")
        for level in (0, 1)
    ),
    Case("CLK is stuck, relays", RELAY, [StuckLine("CLK", 0)], "buses", "lines"),
    Case("no rail monitor", ALL, [I2cFailure(0x48, "absent")], "buses", "rail_monitor"),
    Case("the I2C bus is stuck", ALL, [I2cFailure(0x48, "timeout")], "buses", "rail_monitor"),
    Case("the monitor errs", ALL, [I2cFailure(0x48, "io")], "buses", "rail_monitor"),
    Case("no set-point", ALL, [I2cFailure(0x60, "absent")], "buses", "rail_setpoint"),
    Case("a set-point that wakes up", ALL, [SetpointAtPowerUp(900)], "buses", "rail_setpoint"),
    Case("the stop loop is open", ALL, [StuckLine("EMERGENCY_STOP", 0)], "buses", "emergency_stop"),
    Case("the stop is bridged", ALL, [StuckLine("EMERGENCY_STOP", 1)], "buses", "emergency_stop"),
    Case("the wearer's is bridged", ALL, [StuckLine("WEARER_STOP", 1)], "buses", "wearer_stop"),
    Case("nobody presses", ALL, [], "buses", "emergency_stop", {"is_lazy": True}),
]
CHAIN = [
    Case("read-back is stuck", ALL, [StuckLine("READBACK", 1)], "register", "readback"),
    Case("DATA is cut", ALL, [LineCut("DATA")], "register", "readback"),
    Case("CLK is cut", ALL, [LineCut("CLK")], "register", "readback"),
    Case("a lost clock", ALL, [LostClock(350)], "register", "readback"),
    Case("slow words", ALL, [SlowWords(8)], "timing", "one_word"),
    Case("a noisy kernel", ALL, [SpiJitter(3, 20)], "timing", "spread_of_a_message"),
    Case("SPI fails", ALL, [SpiError(at_message=60)], "timing", "bus"),
]
RAIL = [
    Case("the monitor says 300 V", ALL, [MonitorStuck(300)], "rail", "off"),
    Case("the monitor says 0 V", ALL, [MonitorStuck(0)], "rail", "rise"),
    Case("the rail is low", ALL, [RailOff(0.8)], "rail", "rise"),
    Case("the rail is high", ALL, [RailOff(1.2)], "rail", "rise"),
    Case("the rail does not come", ALL, [RailOff(0.0)], "rail", "rise"),
    Case("the rail does not come, relays", RELAY, [RailOff(0.0)], "rail", "rise"),
    Case("HV ENABLE is cut", ALL, [LineCut("HV")], "rail", "rise"),
    Case("HEARTBEAT is cut", ALL, [LineCut("HEARTBEAT")], "rail", "rise"),
    Case("the rail does not fall", ALL, [RailStays()], "rail", "hv_enable"),
    Case("the rail does not fall, relays", RELAY, [RailStays()], "rail", "hv_enable"),
    Case("the supply cannot be switched", ALL, [EnableStuck()], "rail", "hv_enable"),
    Case("the same, relays", RELAY, [EnableStuck()], "rail", "off"),
    Case("the gate ignores the heartbeat", ALL, [HeartbeatIgnored()], "rail", "heartbeat"),
    Case("the gate has no latch", ALL, [HeartbeatRearms()], "rail", "heartbeat_latch"),
    Case(
        "the emergency stop cuts nothing",
        ALL,
        [StopCutsNothing("emergency_stop")],
        "rail",
        "emergency_stop_gate",
    ),
    Case(
        "the wearer's stop cuts nothing",
        ALL,
        [StopCutsNothing("wearer_stop")],
        "rail",
        "wearer_stop_gate",
    ),
    Case("a slow monostable", ALL, [HeartbeatSlow(150)], "rail", "heartbeat_window"),
    *(
        Case(f"{name} lacks its pull", ALL, [PullMissing(name)], "rail", "killed_lines")
        for name in ("POL", "BL", "LE", "CLK", "HV")
    ),
    Case("POL lacks its pull, no guard", BARE, [PullMissing("POL")], "rail", "killed_lines"),
    Case("LE lacks its pull, relays", RELAY, [PullMissing("LE")], "rail", "killed_lines"),
    Case("a stuck DAC behind a supply", ALL, [DacStuck(200)], "rail", "idle_node_live"),
    Case("an offset behind a supply", ALL, [DacOffset(60.0)], "rail", "idle_node_live"),
    Case("a stuck DAC before relays", RELAY, [DacStuck(200)], "rail", "rise_idle"),
]
PROBE = [
    Case("MISO is stuck low", ALL, [MisoStuck(0)], "probe", "ramp"),
    Case("four times the current", ALL, [DacGain(4.1)], "probe", "ramp"),
    Case("a third more current", ALL, [DacGain(1.3)], "probe", "ramp"),
    Case("another divider", ALL, [AdcScale(1.3)], "probe", "ramp"),
    Case("no rail, nobody sees it", BARE, [RailOff(0.0)], "probe", "ramp"),
    Case("too much current", ALL, [DacGain(1.15)], "probe", "ua_per_code"),
    Case("too little current", ALL, [DacGain(0.75)], "probe", "ua_per_code"),
    Case("too small a leak", ALL, [], "probe", "leak", {"leak_factor": 0.75}),
    Case("too large a leak", ALL, [], "probe", "leak", {"leak_factor": 1.15}),
    Case("another load", ALL, [], "probe", "load_agrees", {"real_load_ohm": 30_000}),
    Case("a finger on the array", ALL, [], "probe", "ramp", {"on_skin": True}),
    Case("LE is cut", BARE, [LineCut("LE")], "probe", "load_agrees"),
    Case("BL is cut", BARE, [LineCut("BL")], "probe", "load_agrees"),
    Case("DATA is cut, nobody reads back", BARE, [LineCut("DATA")], "probe", "load_agrees"),
    Case("the load's output is dead", ALL, [SwitchOutput(1, "open")], "probe", "load_agrees"),
    Case("an output on ground", ALL, [SwitchOutput(2, "ground")], "probe", "load_agrees"),
    Case("solder between two", ALL, [Bridge(5, 6)], "probe", "nothing_else"),
    Case("solder between two, relays", RELAY, [Bridge(5, 6)], "probe", "nothing_else"),
    Case(
        "the kernel holds a pulse up",
        ALL,
        [SpiStall(500, at_message=150)],
        "probe",
        "length_of_a_message",
    ),
    Case("SPI says short", ALL, [SpiShort(at_message=160)], "probe", "bus"),
]
STRONG = [
    Case("a dead output", ALL, [SwitchOutput(9, "open")], "switches", "every_switch"),
    Case("a dead output, relays", RELAY, [SwitchOutput(9, "open")], "switches", "every_switch"),
    Case("an output at the source", ALL, [SwitchOutput(9, "source")], "switches", "every_switch"),
    Case("an output at ground", ALL, [SwitchOutput(9, "ground")], "switches", "every_switch"),
    Case("the wrong SPI mode", ALL, [SpiMode(3)], "source", "adc_bits"),
    Case("a low rail, nobody sees it", BARE, [RailOff(0.8)], "source", "compliance"),
    Case("a slow one-shot", ALL, [], "source", "one_shot", {"one_shot_us": 900}),
]
CASES = [*MACHINE, *BUSES, *CHAIN, *RAIL, *PROBE, *STRONG]


def case_id(case: Case) -> str:
    return case.what.replace(" ", "-")


def rig_of(case: Case, **how: Any) -> SelftestRig:
    return selftest_rig(case.board, faults=case.faults, **{**case.how, **how})


@pytest.mark.parametrize("case", CASES, ids=case_id)
def test_a_fault_is_named_at_its_stage_and_nothing_comes_after_it(case: Case) -> None:
    report = rig_of(case).run()
    failed = [found for found in bad(report) if found[0] != "end"]
    assert not report.passed
    assert {stage for stage, _ in failed} == {case.stage}
    assert (case.stage, case.name) in failed
    later = [one for one in report.checks if one.name == "all"]
    assert all(one.result == "skip" for one in later)


@pytest.mark.parametrize("case", CASES, ids=case_id)
def test_without_a_load_no_pulse_on_skin_exceeds_the_bound_whatever_is_wrong(case: Case) -> None:
    rig = rig_of(case, load_ohm=None, on_skin=True)
    report = rig.run()
    assert report.bound.charge_nc == 15.0
    assert not report.passed
    assert rig.most_charge_nc <= report.bound.charge_nc


@pytest.mark.parametrize("board", [ALL, BARE])
@pytest.mark.parametrize("factor", [1.5, 2.0, 2.3, 3.0])
@pytest.mark.parametrize("skin_ohm", [20_000, 60_000, 200_000])
def test_a_load_that_is_named_but_not_there_raises_nothing_above_the_bound_on_skin(
    board: str, factor: float, skin_ohm: int
) -> None:
    """Current that is too strong through skin that conducts may look like nothing connected."""
    rig = selftest_rig(board, faults=[DacGain(factor)], load_ohm=47_000)
    for electrode in range(rig.loaded.array.count):
        rig.fake.world.touch(electrode, load(float(skin_ohm)))
    report = rig.run()
    assert not report.passed
    assert rig.most_charge_nc <= report.bound.charge_nc


@pytest.mark.parametrize("board", [ALL, BARE, RELAY])
@pytest.mark.parametrize("factor", [1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 10.0, 24.0])
def test_a_source_that_is_too_strong_by_any_factor_stays_within_the_bound_on_skin(
    board: str, factor: float
) -> None:
    rig = selftest_rig(board, faults=[DacGain(factor)], load_ohm=None, on_skin=True)
    report = rig.run()
    assert 0 < rig.most_charge_nc <= report.bound.charge_nc


def test_at_least_twenty_five_kinds_of_trouble_are_tried() -> None:
    assert len({case.faults[0] if case.faults else case.what for case in CASES}) >= 25
    assert len(CASES) == len({case.what for case in CASES})


def test_every_check_that_is_made_or_fails_is_in_the_table_of_what_to_do() -> None:
    table = (Path(__file__).parents[2] / "docs/bring-up.md").read_text(encoding="utf-8")
    told = set(re.findall(r"`(?:[a-z]+: )?([a-z_]+)`", table))
    told |= {f"{name}_idle" for name in told if name.startswith("rise")}
    made = {
        check.name for board in (ALL, BARE, RELAY) for check in selftest_rig(board).run().checks
    }
    assert (made | {case.name for case in CASES}) - told == set()
