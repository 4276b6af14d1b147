"""What is put in at an operation: every fault that the fake can show, by class.

Owns: the classes with their variants, and at which operations each means anything. Must not know:
how an operation is counted, what a fault leads to, what finds it (`bounds.toml`).

A class is what is found by the same checks. What happens once is put in at each chosen operation of
its port; what stays, at those that are chosen for that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

from campaign.client_kinds import of_gateway_and_client
from campaign.helper_kinds import of_helpers
from campaign.kind import BUSES, Doing, Kind, put_in
from campaign.operations import Interference, Killed, Port
from campaign.subject import Subject
from etd_hal.boardfile import BoardFile
from etd_hal.fake import faults
from etd_hal.fake.faults import Fault

MS = 1_000_000
#: A scan of the scenes' frames: after a stall a script may begin another one.
_A_SCAN_MS = 30
#: Longer than a poll, and shorter than what the stopper cuts after.
_A_BEAT_MS = 20
_ANY: tuple[Port, ...] = ("spi", "set", "get", "edges", "i2c")


def kinds_of(board: BoardFile, *, has_link: bool = True, on_bench: bool = False) -> list[Kind]:
    """All that this board can have. `has_link`: an engine, with a gateway and a client; `on_bench`:
    a self-test, which looks at all of the machine.
    """
    found = [*_of_calls(), *_of_processes(), *_of_pulls(board), *_of_edges(), *_of_words(),
             *_of_wires(board), *_of_source(), *_of_readings(), *_of_supply(board),
             *_of_stops(board), *_of_outputs(), *_of_machine(on_bench=on_bench)]  # fmt: skip
    return [*found, *of_gateway_and_client(), *of_helpers(board)] if has_link else found


def _staying(fault_class: str, *variants: Fault) -> Iterator[Kind]:
    for fault in variants:
        yield Kind(fault_class, repr(fault), ("spi",), put_in(fault), stays=True, fault=fault)


def _aside(fault_class: str, *variants: Fault) -> Iterator[Kind]:
    for kind in _staying(fault_class, *variants):
        yield replace(kind, is_aside=True)


def _once(fault_class: str, port: Port, *variants: Fault) -> Iterator[Kind]:
    for fault in variants:
        yield Kind(fault_class, repr(fault), (port,), put_in(fault), fault=fault)


def _of_calls() -> Iterator[Kind]:
    for error in ("io", "timeout", "gone"):
        failing = _answer(error)
        yield Kind("a call fails, nothing done", error, _ANY, failing, shifts_ms=_A_SCAN_MS)
    yield Kind("a message succeeds, nothing sent", "once", ("spi",), _answer("not done"))
    yield Kind("lines are not moved, and it succeeds", "once", ("set",), _answer("not done"))
    inputs: tuple[Port, ...] = ("get", "edges", "i2c")
    yield Kind("an input reads zeros", "once", inputs, _answer("not done"), shifts_ms=_A_SCAN_MS)
    for at_transfer in (0, 1, 3):
        yield from _once("a message is cut off", "spi", faults.SpiError(at_transfer=at_transfer))
    yield from _once("a short count", "spi", faults.SpiShort())


def _answer(interference: Interference) -> Doing:
    return lambda _: interference


def _of_processes() -> Iterator[Kind]:
    yield Kind("the engine is killed", "lines kept", _ANY, _kill)
    yield Kind("the engine is killed", "lines float", _ANY, _kill_and_float)
    for stall_ms in (1, _A_BEAT_MS, 5_000):
        name, stall = f"{stall_ms} ms", faults.SpiStall(stall_us=stall_ms * 1_000)
        held_up, late = _held_up(stall_ms), _A_SCAN_MS
        # At each bus for as long as a scan; what takes longer or less is the same at any of them.
        ports = _ANY if stall_ms == _A_BEAT_MS else BUSES
        yield Kind("the engine is held up", name, ports, held_up, shifts_ms=late)
        within = Kind("held up within a message", name, ("spi",), put_in(stall), fault=stall)
        yield replace(within, shifts_ms=late)


def _kill(_: Subject) -> None:
    raise Killed


def _kill_and_float(subject: Subject) -> None:
    subject.fake.let_float()
    raise Killed


def _of_pulls(board: BoardFile) -> Iterator[Kind]:
    """A missing pull shows only once nobody drives its line: of those that hold what is safe."""
    for name in ("POL", "BL", "HV"):
        if name in board.used_lines():
            missing = faults.PullMissing(name)
            dies = _each_in_turn(put_in(missing), _kill_and_float)
            what = "the engine is killed, and a pull is missing"
            yield Kind(what, repr(missing), ("spi",), dies, fault=missing)


def _each_in_turn(*doings: Doing) -> Doing:
    def do(subject: Subject) -> None:
        for doing in doings:
            doing(subject)

    return do


def _held_up(stall_ms: int) -> Doing:
    return lambda subject: subject.clock.spend(stall_ms * MS)


def _of_edges() -> Iterator[Kind]:
    yield from _once(
        "a bit is lost, extra or flipped",
        "set",
        faults.LostClock(),
        faults.ExtraClock(),
        faults.DataFlipped(),
    )
    yield from _staying(
        "bits are lost, extra or flipped",
        faults.LostClock(every=7),
        faults.ExtraClock(every=7),
        faults.DataFlipped(every=7),
    )
    yield from _once("an edge of the latch is lost", "set", faults.LatchIgnored())
    yield from _staying("the latch does not take over", faults.LatchIgnored(every=1))


def _of_words() -> Iterator[Kind]:
    yield from _once("a chip select is lost", "spi", faults.LostSync())
    yield from _staying("chip selects are lost", *(faults.LostSync(every=n) for n in (2, 3)))
    bits = (9, 11, 12, 13, 14)
    yield from _once(
        "a bit to the DAC is flipped",
        "spi",
        *(faults.MosiFlipped(bit, at_word) for bit in bits for at_word in (1, 2)),
    )
    yield from _staying(
        "bits to the DAC are flipped", *(faults.MosiFlipped(b, every=5) for b in bits)
    )
    yield from _staying("data to the DAC is stuck", *(faults.MosiStuck(level) for level in (0, 1)))
    modes = (faults.SpiMode(0), faults.SpiMode(2), faults.HoldShort())
    yield from _staying("the bus is in another mode", *modes)
    yield from _staying("words are slow", faults.SlowWords(20), faults.SlowWords(200))
    yield from _staying("messages are late", faults.SpiJitter(every=3, late_us=300))


def _of_wires(board: BoardFile) -> Iterator[Kind]:
    names = [name for name in ("POL", "DATA", "LE", "BL", "CLK") if name in board.used_lines()]
    for name in names:
        for level in (0, 1):
            stuck = faults.StuckLine(name, level), faults.StuckBehind(name, level)
            yield from _staying(f"{name} is stuck at {level}", *stuck)
        yield from _staying(f"{name} is cut or inverted", faults.LineCut(name))
        yield from _staying(f"{name} is cut or inverted", faults.LineInverted(name))
    for first, second in pairwise(names):
        yield from _staying("two lines are swapped", faults.LinesSwapped(first, second))


def _of_source() -> Iterator[Kind]:
    yield from _staying("the DAC is stuck", *(faults.DacStuck(code) for code in (0, 40, 400, 4095)))
    yield from _staying("an offset of 30 uA", faults.DacOffset(30.0))
    yield from _staying("an offset", *(faults.DacOffset(ua) for ua in (100.0, 1_000.0)))
    gains = (faults.DacGain(factor) for factor in (0.5, 1.5, 3.0))
    yield from _staying("a gain", *gains, faults.GainAbove(code=100, factor=3.0))
    yield from _staying("a gain above a probe's current", faults.GainAbove(code=130, factor=3.0))
    yield from _staying("an overshoot", faults.Overshoot(factor=3.0, until_us=10.0))
    yield from _staying("the source saturates", faults.Saturation(current_ua=100.0))
    yield from _staying("a gain of twenty", faults.DacGain(20.0))
    yield from _staying("the source is short", faults.SourceShort())


def _of_readings() -> Iterator[Kind]:
    flipped = (faults.MisoFlipped(bit) for bit in (5, 11, 13))
    yield from _once("a bit of a reading is flipped", "spi", *flipped)
    yield from _staying(
        "readings lie",
        *(faults.AdcStuck(code) for code in (0, 100, 4095)),
        *(faults.AdcScale(factor) for factor in (0.5, 2.0)),
        *(faults.AdcBitStuck(bit, level) for bit in (5, 11) for level in (0, 1)),
        faults.AdcNoise(sigma=20.0),
        faults.MisoFlipped(bit=11, every=5),
        faults.MisoStuck(0),
        faults.MisoStuck(1),
    )


def _of_supply(board: BoardFile) -> Iterator[Kind]:
    guards = board.guards
    yield from _staying("the rail is off", *(faults.RailOff(factor) for factor in (0.0, 0.5, 1.3)))
    if guards.hv_enable != "absent":
        yield from _staying(
            "the supply cannot be switched off", faults.EnableStuck(), faults.RailStays()
        )
    if guards.rail_monitor != "absent":
        address = guards.rail_monitor.address
        yield from _staying("the rail's sensor lies", faults.MonitorStuck(rail_v=300.0))
        far_off = (faults.MonitorStuck(rail_v=volts) for volts in (0.0, 400.0))
        yield from _staying("the rail's sensor says too little or too much", *far_off)
        gone = faults.I2cFailure(address, "absent"), faults.I2cFailure(address, "timeout")
        yield from _staying("the rail's sensor is gone", *gone)
    if guards.heartbeat != "absent":
        yield from _staying("the heartbeat is ignored", faults.HeartbeatIgnored())
        levels = (faults.HeartbeatByLevel(level) for level in (0, 1))
        wrong = faults.HeartbeatRearms(), *levels, faults.HeartbeatSlow(extra_ms=150)
        yield from _aside("the heartbeat's gate is not as it should be", *wrong)
    if board.rail_setpoint != "absent":
        wakes = faults.SetpointAtPowerUp(code=4_000)
        yield from _aside("the set-point wakes up high", wakes)


def _of_stops(board: BoardFile) -> Iterator[Kind]:
    """Of those whose second contact cuts the supply; both are wired alike."""
    guards, name = board.guards, "a stop does not cut the supply"
    if guards.stop_cuts_supply and guards.emergency_stop != "absent":
        yield from _aside(name, faults.StopCutsNothing("emergency_stop"))
    if guards.stop_cuts_supply and guards.wearer_stop != "absent":
        yield from _aside(name, faults.StopCutsLate("wearer_stop", late_ms=300))


def _of_outputs() -> Iterator[Kind]:
    yield from _staying("an output is stuck on the source", faults.SwitchOutput(2, "source"))
    stuck = faults.SwitchOutput(2, "ground"), faults.SwitchOutput(2, "open")
    yield from _staying("an output is stuck on ground or open", *stuck)
    yield from _staying("an output takes another along", faults.AlsoSwitches(2, 5))
    yield from _staying("outputs are swapped", faults.OutputsSwapped(2, 5))
    yield from _staying("a solder bridge", faults.Bridge(2, 5))
    series = faults.OutputSeries(output=2, resistance_ohm=15_000.0)
    in_series = _each_in_turn(put_in(series), _touch_anew)
    name = "a switch has a resistance"
    made = Kind(name, repr(series), ("spi",), in_series, stays=True, is_aside=True)
    yield replace(made, fault=series)


def _touch_anew(subject: Subject) -> None:
    """A resistance behind an output counts from the next contact on."""
    for electrode in range(subject.body.electrode_count):
        subject.fake.world.touch(electrode, subject.body.contact(electrode))


def _of_machine(*, on_bench: bool) -> Iterator[Kind]:
    """What an engine is told of heat and a weak supply it says, and does nothing about: only a
    self-test judges them. What is there from a machine's start on, its own cases have
    (`tests/selftest_cases.py`).
    """
    yield from _staying("the machine's clock follows its load", faults.ClockSteps(2.5, 500))
    if on_bench:
        troubles = (faults.MachineTrouble("under_voltage"), faults.MachineTrouble("hot"))
        yield from _aside("the machine is in trouble", *troubles)
