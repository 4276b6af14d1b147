"""What is put in at an operation: every fault that the fake can show, by class.

Owns: the classes with their variants, and at which operations each means anything. Must not know:
how an operation is counted, what a fault leads to.

What happens once is put in at each operation of its port; what stays, at messages and at some of
the other operations: between two of these it is the same fault.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

from campaign.operations import Interference, Killed, Port
from campaign.own_memory import OwnChannel
from engine_rig import EngineRig
from etd_hal.boardfile import BoardFile
from etd_hal.fake import faults
from etd_hal.fake.faults import Fault

#: Done to a rig directly before the operation.
Doing = Callable[[EngineRig], Interference | None]

MS = 1_000_000
BUSES: tuple[Port, ...] = ("spi", "set")
_ANY: tuple[Port, ...] = ("spi", "set", "get", "edges", "i2c")
#: Of operations that are no messages, each so many-th has what stays.
STAYING_EVERY = 101


@dataclass(frozen=True)
class Kind:
    """One variant of a class of faults."""

    fault_class: str
    variant: str
    ports: tuple[Port, ...]
    do: Doing
    stays: bool = False
    #: Another one, so many operations later.
    then: Kind | None = None
    then_after: int = 0

    @property
    def name(self) -> str:
        return f"{self.fault_class}: {self.variant}"

    def applies(self, number: int, port: Port) -> bool:
        if not self.stays:
            return port in self.ports
        return port == "spi" or number % STAYING_EVERY == 0


def kinds_of(board: BoardFile) -> list[Kind]:
    """All that this board can have."""
    return [*_of_calls(), *_of_processes(), *_of_buses(), *_of_wires(board), *_of_source(),
            *_of_readings(), *_of_supply(board), *_of_outputs(), *_of_gateway()]  # fmt: skip


def _put_in(fault: Fault) -> Doing:
    return lambda rig: rig.fake.world.put_in(fault)


def _staying(fault_class: str, *variants: Fault) -> Iterator[Kind]:
    for fault in variants:
        yield Kind(fault_class, repr(fault), ("spi",), _put_in(fault), stays=True)


def _of_calls() -> Iterator[Kind]:
    for error in ("io", "timeout", "gone"):
        yield Kind("a call fails, nothing done", error, _ANY, _answer(error))
    yield Kind("a call succeeds, nothing done", "once", _ANY, _answer("not done"))
    for at_transfer in (0, 1, 3):
        fault = faults.SpiError(at_transfer=at_transfer)
        yield Kind("a message is cut off", repr(fault), ("spi",), _put_in(fault))
    yield Kind("a short count", "once", ("spi",), _put_in(faults.SpiShort()))


def _answer(interference: Interference) -> Doing:
    return lambda _: interference


def _of_processes() -> Iterator[Kind]:
    yield Kind("the engine is killed", "there", BUSES, _kill)
    for stall_ms in (1, 20, 5_000):
        yield Kind("the engine is held up", f"{stall_ms} ms", BUSES, _held_up(stall_ms))
        stall = faults.SpiStall(stall_us=stall_ms * 1_000)
        yield Kind("held up within a message", f"{stall_ms} ms", ("spi",), _put_in(stall))


def _kill(rig: EngineRig) -> None:
    raise Killed


def _held_up(stall_ms: int) -> Doing:
    return lambda rig: rig.clock.spend(stall_ms * MS)


def _of_buses() -> Iterator[Kind]:
    yield Kind("an edge is lost", "CLK", ("set",), _put_in(faults.LostClock()))
    yield Kind("an edge is lost", "LE", ("set",), _put_in(faults.LatchIgnored()))
    yield Kind("an edge is lost", "chip select", ("spi",), _put_in(faults.LostSync()))
    yield from _staying(
        "edges are lost",
        faults.LostClock(every=7),
        faults.LatchIgnored(every=1),
        faults.LostSync(every=2),
        faults.LostSync(every=3),
    )
    yield from _staying(
        "the bus is wrong",
        faults.SpiMode(mode=0),
        faults.SpiMode(mode=2),
        faults.HoldShort(),
        faults.SlowWords(extra_us=20),
        faults.SlowWords(extra_us=200),
        faults.SpiJitter(every=3, late_us=300),
    )


def _of_wires(board: BoardFile) -> Iterator[Kind]:
    names = [name for name in ("POL", "DATA", "LE", "BL", "CLK") if name in board.used_lines()]
    for name in names:
        for level in (0, 1):
            yield from _staying(
                "a line is stuck",
                faults.StuckLine(name, level),
                faults.StuckBehind(name, level),
            )
        yield from _staying("a wire is cut", faults.LineCut(name))
        yield from _staying("a line is inverted", faults.LineInverted(name))
    for first, second in pairwise(names):
        yield from _staying("two lines are swapped", faults.LinesSwapped(first, second))


def _of_source() -> Iterator[Kind]:
    yield from _staying("the DAC is stuck", *(faults.DacStuck(code) for code in (0, 40, 400, 4095)))
    yield from _staying("an offset", *(faults.DacOffset(ua) for ua in (30.0, 100.0, 1_000.0)))
    yield from _staying(
        "a gain",
        *(faults.DacGain(factor) for factor in (0.5, 1.5, 3.0)),
        faults.GainAbove(code=100, factor=3.0),
        faults.Overshoot(factor=3.0, until_us=10.0),
        faults.Saturation(current_ua=100.0),
    )
    yield from _staying("the source is short", faults.DacGain(20.0))


def _of_readings() -> Iterator[Kind]:
    yield from _staying(
        "readings lie",
        *(faults.AdcStuck(code) for code in (0, 100, 4095)),
        *(faults.AdcScale(factor) for factor in (0.5, 2.0)),
        *(faults.AdcBitStuck(bit, level) for bit in (5, 11) for level in (0, 1)),
        faults.AdcNoise(sigma=20.0),
        faults.MisoStuck(0),
        faults.MisoStuck(1),
    )


def _of_supply(board: BoardFile) -> Iterator[Kind]:
    yield from _staying("the rail is off", *(faults.RailOff(factor) for factor in (0.5, 1.3)))
    guards = board.guards
    if guards.hv_enable != "absent":
        yield from _staying(
            "the supply cannot be switched off", faults.EnableStuck(), faults.RailStays()
        )
    if guards.rail_monitor != "absent":
        yield from _staying("the rail's sensor lies", faults.MonitorStuck(rail_v=300.0))
    if guards.heartbeat != "absent":
        yield from _staying("the heartbeat is ignored", faults.HeartbeatIgnored())


def _of_outputs() -> Iterator[Kind]:
    yield from _staying(
        "an output is stuck",
        *(faults.SwitchOutput(2, side) for side in ("open", "source", "ground")),
    )
    yield from _staying("an output takes another along", faults.AlsoSwitches(2, 5))
    yield from _staying("outputs are swapped", faults.OutputsSwapped(2, 5))
    yield from _staying("a solder bridge", faults.Bridge(2, 5))


def _of_gateway() -> Iterator[Kind]:
    yield Kind("the gateway dies", "there", ("spi",), lambda rig: rig.commands.close())
    yield Kind("the gateway hangs", "there", ("spi",), _hang)
    for junk in (b"\xc1", b"\x81" * 5_000, b"\x80"):
        yield Kind("the gateway sends junk", repr(junk[:4]), ("spi",), _junk(junk))


def _hang(rig: EngineRig) -> None:
    rig.is_gateway_alive = False


def _junk(data: bytes) -> Doing:
    def do(rig: EngineRig) -> None:
        assert isinstance(rig.commands, OwnChannel)
        rig.commands.send_bytes(data)

    return do
