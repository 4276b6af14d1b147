"""A `Board` on the stepped fake, and the questions that tests of the wire ask of its trace.

Owns: how tests bring a board to life and part its trace into calls. Time passes only as it is
spent.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import msgspec

from etd_body.interface import Sides
from etd_hal.board import Board
from etd_hal.boardfile import BoardFile, MachineFile, load_machine
from etd_hal.errors import BusError
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.faults import Fault
from etd_hal.fake.world import Touchable
from etd_hal.phase import Pulse, PulseResult
from etd_hal.ports import Changes, Edge, Gpio, Message, Transfer
from etd_hal.selection import Selection
from etd_hal.switch_shadow import Approval, Prepulse
from stepped_board import BOARDS, SteppedBoard, shipped_board, stepped_board

MACHINES = BOARDS.parent / "machines"
#: By the datasheet: control bits 00, twelve bits of code, two that do not count.
ZERO_WORD = b"\x00\x00"


def machine_file(name: str = "pi4") -> MachineFile:
    return load_machine(MACHINES / f"{name}.toml")


def changed(board: BoardFile, part: str, **values: object) -> BoardFile:
    """A board whose `part` (source, maxima, guards, switch) has other values."""
    return msgspec.structs.replace(
        board, **{part: msgspec.structs.replace(getattr(board, part), **values)}
    )


def pulse_words(code: int, *delays_us: int) -> Message:
    """A pulse by hand: on, delays, off."""
    on = (code << 2).to_bytes(2, "big")
    holds = tuple(Transfer(delay_us=delay) for delay in delays_us)
    return Message((Transfer(on, cs_change=True), *holds, Transfer(ZERO_WORD)))


def fire_phase(
    board: Board,
    pulse: Pulse,
    selection: Selection,
    is_anodic: bool,
    current_ua: int,
    width_us: int,
    prepulse: Prepulse | None = None,
    *,
    is_blanked: bool = False,
) -> PulseResult:
    """Send one phase, approved as `current_ua` for `width_us`, with `prepulse` before it."""
    source, ground = selection.source(is_anodic), selection.ground(is_anodic)
    approval = Approval(source, ground, current_ua, width_us, prepulse, is_blanked)
    return board.result(pulse, board.send(pulse, approval))


@dataclass
class FailingGpio:
    """Lines that fail: each `set` whose number (from 0) is in `fails`; or that succeed and do
    nothing: those in `does_nothing`. Without `reads` no line can be read.
    """

    inner: Gpio
    fails: frozenset[int] = frozenset()
    does_nothing: frozenset[int] = frozenset()
    reads: bool = True
    sent: list[Changes] = field(default_factory=list)

    @property
    def calls(self) -> int:
        return len(self.sent)

    def set(self, changes: Changes) -> None:
        self.sent.append(changes)
        if self.calls - 1 in self.fails:
            raise BusError("io", "the lines", "set")
        if self.calls - 1 not in self.does_nothing:
            self.inner.set(changes)

    def get(self, line: int) -> int:
        if not self.reads:
            raise BusError("io", "the lines", "get")
        return self.inner.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self.inner.edges()


@dataclass
class BoardRig:
    """See the module; `board_rig` makes one."""

    stepped: SteppedBoard
    board: Board
    gpio: FailingGpio

    @property
    def clock(self) -> SteppedClock:
        return self.stepped.clock

    @property
    def fake(self) -> FakeBoard:
        return self.stepped.fake

    @property
    def file(self) -> BoardFile:
        return self.stepped.board

    @property
    def sides(self) -> Sides:
        """What each electrode is connected to now, relays that were under way included."""
        self.stepped.backend.gpio.edges()
        return self.fake.sides

    def begin(self) -> None:
        """As a daemon does: safe, calibrated, supply on, permitted up to the maximum."""
        assert self.board.safe_off() == ()
        self.board.calibrate()
        self.board.supply_on()
        self.board.guard.permit(self.file.maxima.current_ua)

    def visit(
        self,
        output: int,
        *phases: bool,
        current_ua: int = 1_000,
        width_us: int = 100,
        returns: tuple[int, ...] | None = None,
        whole: bool = False,
        prepulse: Prepulse | None = None,
    ) -> PulseResult:
        """One whole visit; phases are anodic (True) or cathodic. Returns the last shot."""
        first, *others = phases or (True,)
        board = self.board
        selection = board.selection(output, returns)
        pulse = board.pulse(current_ua, width_us, prepulse)
        board.prepare(selection, whole)
        board.connect(selection, first)
        result = fire_phase(board, pulse, selection, first, current_ua, width_us, prepulse)
        for is_anodic in others:
            board.flip(selection, is_anodic)
            result = fire_phase(board, pulse, selection, is_anodic, current_ua, width_us, prepulse)
        board.discharge()
        return result

    def records(self) -> list[dict[str, Any]]:
        """The trace so far, its header left out."""
        return self.stepped.trace_lines()[1:]

    def since(self, count: int) -> list[dict[str, Any]]:
        """The trace after its first `count` records."""
        return self.records()[count:]

    def names(self) -> dict[int, str]:
        return {line: name for name, line in self.file.used_lines().items()}

    def story(self, count: int = 0) -> list[str]:
        """What crossed the wires since record `count`: "BL=1", "dac=1330", in order of time.

        A word of the DAC stands where chip select rises and it takes effect.
        """
        names, told, word = self.names(), [], ""
        for record in self.since(count):
            if record["bus"] == "gpio":
                told.append(f"{names[record['line']]}={record['value']}")
            elif record["bus"] == "spi" and record["event"] == "transfer":
                word = record["tx"] or word
            elif record["bus"] == "spi" and record["event"] == "cs" and not record["active"]:
                told.append(f"dac={word}")
        return told

    def times(self, name: str, value: int, count: int = 0) -> list[int]:
        """When a line was set to `value`, since record `count`."""
        line = self.file.used_lines()[name]
        return [
            record["t_ns"]
            for record in self.since(count)
            if (record["bus"], record.get("line"), record.get("value")) == ("gpio", line, value)
        ]

    def body(self, count: int = 0) -> list[dict[str, Any]]:
        """The body's own account of each phase since record `count`."""
        return [record for record in self.since(count) if record["bus"] == "body"]


def board_rig(
    name: str = "kajimoto-hv507",
    *,
    board: BoardFile | None = None,
    machine: MachineFile | None = None,
    faults: Iterable[Fault] = (),
    body: Touchable | None = None,
) -> BoardRig:
    """A board with all its outputs on one fingertip; nothing was called yet."""
    stepped = stepped_board(board=board or shipped_board(name), faults=faults, body=body)
    gpio = FailingGpio(stepped.backend.gpio)
    made = Board(
        stepped.board,
        machine or machine_file(),
        stepped.backend.codec,
        stepped.backend.spi,
        gpio,
        stepped.clock,
    )
    return BoardRig(stepped, made, gpio)
