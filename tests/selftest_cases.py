"""What can be wrong with a board, each with the check of a self-test that must say so.

Owns: the cases. Must not know: what is asserted of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

from etd_hal.fake.faults import (
    AdcBitStuck,
    AdcScale,
    AlsoSwitches,
    Bridge,
    DacGain,
    DacOffset,
    DacStuck,
    EnableStuck,
    Fault,
    GainAbove,
    HeartbeatByLevel,
    HeartbeatIgnored,
    HeartbeatRearms,
    HeartbeatSlow,
    HoldShort,
    I2cFailure,
    LatchIgnored,
    LineCut,
    LineInverted,
    LinesSwapped,
    LostClock,
    MachineTrouble,
    MisoStuck,
    MonitorStuck,
    OutputSeries,
    OutputsSwapped,
    Overshoot,
    PullMissing,
    RailOff,
    RailStays,
    Saturation,
    SetpointAtPowerUp,
    SlowWords,
    SpiError,
    SpiJitter,
    SpiMode,
    SpiShort,
    SpiStall,
    StopCutsLate,
    StopCutsNothing,
    StuckBehind,
    StuckLine,
    SwitchOutput,
)
from selftest_rig import LOAD_OHM, SECOND_OHM, SelftestRig, selftest_rig

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
    Case(
        "a clock that follows load",
        ALL,
        [MachineTrouble("clock_follows_load")],
        "machine",
        "cpu_clock",
    ),
    Case("no gpiod", ALL, [MachineTrouble("package_missing")], "machine", "libraries"),
    Case("a Pi 5", ALL, [MachineTrouble("wrong_model")], "machine", "model"),
]
#: Levels that are not those of the safe state: it is read back before each line is.
NOT_SAFE: tuple[tuple[str, Literal[0, 1]], ...] = (("POL", 0), ("BL", 1))
BUSES = [
    Case("MISO floats high", ALL, [MisoStuck(1)], "buses", "spi_echo"),
    Case("the DAC does not move", BARE, [DacStuck(200)], "buses", "idle_node"),
    Case("the source has an offset", BARE, [DacOffset(60.0)], "buses", "idle_node"),
    *(
        Case(f"{name} is stuck at {level}", ALL, [StuckLine(name, level)], "buses", "lines")
        for name in ("POL", "BL", "LE", "CLK", "DATA", "HEARTBEAT", "SYNC")
        for level in (0, 1)
        if (name, level) not in NOT_SAFE
    ),
    *(
        Case(f"{name} is stuck at {level}", ALL, [StuckLine(name, level)], "buses", "safe_state")
        for name, level in NOT_SAFE
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
    Case("slow words", ALL, [SlowWords(10)], "timing", "one_word"),
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
    *(
        Case(f"a gate that {level} holds on", ALL, [HeartbeatByLevel(level)], "rail", "heartbeat")
        for level in (0, 1)
    ),
    Case("HEARTBEAT is stuck at 0 behind", ALL, [StuckBehind("HEARTBEAT", 0)], "rail", "rise"),
    Case("HEARTBEAT is stuck at 1 behind", ALL, [StuckBehind("HEARTBEAT", 1)], "rail", "rise"),
    Case("HV is stuck at 0 behind", ALL, [StuckBehind("HV", 0)], "rail", "rise"),
    Case("HV is stuck at 1 behind", ALL, [StuckBehind("HV", 1)], "rail", "hv_enable"),
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
    Case("80 ms for 20", ALL, [HeartbeatSlow(60)], "rail", "heartbeat_window"),
    Case("50 ms for 20", ALL, [HeartbeatSlow(30)], "rail", "heartbeat_window"),
    *(
        Case(
            f"the wearer's stop cuts {late_ms} ms late",
            ALL,
            [StopCutsLate("wearer_stop", late_ms)],
            "rail",
            "wearer_stop_gate",
        )
        for late_ms in (80, 1_000)
    ),
    Case(
        "the emergency stop cuts late",
        ALL,
        [StopCutsLate("emergency_stop", 300)],
        "rail",
        "emergency_stop_gate",
    ),
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
TABLE = [
    *(
        Case(f"{fault}, {board}", board, [fault], "table", "truth_table")
        for board in (ALL, BARE)
        for fault in (
            LinesSwapped("BL", "POL"),
            LineInverted("POL"),
            LineInverted("BL"),
            StuckBehind("POL", 0),
            StuckBehind("POL", 1),
            StuckBehind("BL", 0),
            StuckBehind("BL", 1),
        )
    ),
    Case("POL is cut", BARE, [LineCut("POL")], "table", "truth_table"),
    Case("LE is cut", BARE, [LineCut("LE")], "table", "truth_table"),
    Case("BL is cut", BARE, [LineCut("BL")], "table", "truth_table"),
    Case("DATA is cut, nobody reads back", BARE, [LineCut("DATA")], "table", "truth_table"),
    Case("the load's output is dead", ALL, [SwitchOutput(1, "open")], "table", "truth_table"),
    Case("an output on ground", ALL, [SwitchOutput(2, "ground")], "table", "load_back"),
    Case("the latch stays shut", ALL, [StuckBehind("LE", 0)], "table", "truth_table"),
    *(
        Case(f"solder at the load, {board}", board, [Bridge(1, 2)], "table", "truth_table")
        for board in (ALL, BARE)
    ),
    Case("the fixed end's wire on another", ALL, [OutputsSwapped(1, 2)], "table", "truth_table"),
]
PROBE = [
    Case("MISO is stuck low", ALL, [MisoStuck(0)], "array", "ramp"),
    Case("four times the current", ALL, [DacGain(4.1)], "array", "ramp"),
    Case("a third more current", ALL, [DacGain(1.3)], "array", "ramp"),
    Case("another divider", ALL, [AdcScale(1.3)], "array", "ramp"),
    Case("no rail, nobody sees it", BARE, [RailOff(0.0)], "array", "ramp"),
    Case("too much current", ALL, [DacGain(1.15)], "probe", "ua_per_code"),
    Case("too little current", ALL, [DacGain(0.75)], "probe", "ua_per_code"),
    Case("too small a leak", ALL, [], "probe", "leak", {"leak_factor": 0.75}),
    Case("too large a leak", ALL, [], "probe", "leak", {"leak_factor": 1.15}),
    Case("another load", ALL, [], "probe", "load_agrees", {"really_ohm": {LOAD_OHM: 30_000}}),
    Case("a finger on the array", ALL, [], "array", "ramp", {"on_skin": True}),
    Case("the latch stays open", ALL, [StuckBehind("LE", 1)], "probe", "latch_holds"),
    Case("the latch stays open, bare", BARE, [StuckBehind("LE", 1)], "probe", "latch_holds"),
    Case("nothing is copied, relays", RELAY, [StuckBehind("LE", 1)], "probe", "load_agrees"),
    Case("solder between two", ALL, [Bridge(5, 6)], "array", "nothing_else"),
    Case("solder between two, relays", RELAY, [Bridge(5, 6)], "array", "nothing_else"),
    Case("solder at the load, relays", RELAY, [Bridge(1, 2)], "probe", "load_agrees"),
    *(
        Case(
            f"a short for a load, {ohm} ohm",
            ALL,
            [],
            "probe",
            "load_agrees",
            {"really_ohm": {LOAD_OHM: ohm}},
        )
        for ohm in (0.1, 100, 1_000)
    ),
    Case(
        "the kernel holds a pulse up",
        ALL,
        [SpiStall(500, at_message=150)],
        "array",
        "length_of_a_message",
    ),
    Case("two relays at once", RELAY, [AlsoSwitches(5, 6)], "array", "nothing_else"),
    Case("two relays to ground", RELAY, [AlsoSwitches(5, 6, "cathodic")], "array", "nothing_else"),
    Case("the load's wire on another", ALL, [OutputsSwapped(1, 9)], "array", "nothing_else"),
    Case("SPI mode 0, and its edge late", ALL, [SpiMode(0), HoldShort()], "array", "ramp"),
    Case("SPI mode 3, and its edge late", BARE, [SpiMode(3), HoldShort()], "array", "ramp"),
    Case("SPI says short", ALL, [SpiShort(at_message=160)], "array", "bus"),
]
STRONG = [
    Case("a dead output", ALL, [SwitchOutput(9, "open")], "switches", "every_switch"),
    Case("a dead output, relays", RELAY, [SwitchOutput(9, "open")], "switches", "every_switch"),
    Case("an output at the source", ALL, [SwitchOutput(9, "source")], "switches", "every_switch"),
    Case("an output at ground", ALL, [SwitchOutput(9, "ground")], "switches", "every_switch"),
    *(
        Case(f"{what}, {board}", board, [OutputsSwapped(5, 9)], "switches", "every_switch")
        for what, board in (("swapped wires", ALL), ("swapped wires", RELAY))
    ),
    Case("two outputs at once", ALL, [AlsoSwitches(5, 6)], "switches", "one_at_a_time"),
    Case("the other way about", BARE, [AlsoSwitches(6, 5)], "switches", "one_at_a_time"),
    Case("two on the source", ALL, [AlsoSwitches(5, 6, "anodic")], "switches", "one_at_a_time"),
    Case("two on ground", ALL, [AlsoSwitches(5, 6, "cathodic")], "switches", "one_at_a_time"),
    Case("two on it, bare", BARE, [AlsoSwitches(6, 5, "cathodic")], "switches", "one_at_a_time"),
    Case("one with the fixed end", ALL, [AlsoSwitches(1, 6)], "switches", "one_at_a_time"),
    Case("half a switch", ALL, [OutputSeries(9, 15_000)], "switches", "every_switch"),
    Case("half a switch, relays", RELAY, [OutputSeries(9, 15_000)], "switches", "every_switch"),
    Case("a fifth of it", ALL, [OutputSeries(9, 5_000)], "switches", "every_switch_again"),
    Case("a fifth, relays", RELAY, [OutputSeries(9, 5_000)], "switches", "every_switch_again"),
    Case(
        "another second load",
        ALL,
        [],
        "switches",
        "second_load",
        {"really_ohm": {SECOND_OHM: 30_000}},
    ),
    *(
        Case(f"{type(fault).__name__}, {board}", board, [fault], "source", "every_time")
        for board, fault in (
            (BARE, LatchIgnored(every=103)),
            (ALL, LatchIgnored(every=199)),
            (RELAY, LatchIgnored(every=337)),
            (RELAY, LostClock(every=9_973)),
        )
    ),
    Case("too strong from a code on", ALL, [GainAbove(1_000, 2.0)], "source", "steps"),
    Case("too strong above probes", RELAY, [GainAbove(60, 1.5)], "source", "steps"),
    *(
        Case(f"{times} times too strong at first, {board}", board, [fault], stage, course)
        for board, stage in ((ALL, "array"), (BARE, "array"), (RELAY, "rail"))
        for course, times, fault in (
            ("course_of_a_pulse", 1.5, Overshoot(1.5, 12.0)),
            ("course_of_a_pulse", 24, Overshoot(24.0, 30.0)),
        )
    ),
    Case("a third too strong at first", ALL, [Overshoot(1.3, 30.0)], "source", "course_of_a_pulse"),
    Case("a source that saturates", ALL, [Saturation(4_000)], "source", "linearity"),
    Case("too weak from a code on", BARE, [GainAbove(1_000, 0.5)], "source", "linearity"),
    Case("the wrong SPI mode", ALL, [SpiMode(3)], "source", "adc_bits"),
    Case("the ADC's lowest bit is stuck", ALL, [AdcBitStuck(0, 1)], "source", "adc_bits"),
    Case("a low rail, nobody sees it", BARE, [RailOff(0.8)], "source", "compliance"),
    *(
        Case(
            f"a rail {factor} times too high, {board}",
            board,
            [RailOff(factor)],
            "source",
            "compliance",
        )
        for board in (BARE, RELAY)
        for factor in (1.2, 1.5, 2.0)
    ),
    Case("a slow one-shot", ALL, [], "source", "one_shot", {"one_shot_us": 900}),
]
CASES = [*MACHINE, *BUSES, *CHAIN, *RAIL, *TABLE, *PROBE, *STRONG]


def case_id(case: Case) -> str:
    return case.what.replace(" ", "-")


def rig_of(case: Case, **how: Any) -> SelftestRig:
    return selftest_rig(case.board, faults=case.faults, **{**case.how, **how})
