"""One wrong bit between the drivers and the guard: refused, or harmless on the wires.

A bit of a word, of a delay, or chip select in the message of a pulse; the level of one line in the
calls that select an output. What passes all the same gives nobody anything that was not approved.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import pytest

from etd.files.resources import find
from etd_hal.board import Board
from etd_hal.boardfile import load_machine
from etd_hal.chips.hv507 import HalfBridgeSwitch
from etd_hal.errors import BusError, GuardRefusal
from etd_hal.ports import Changes, Edge, Gpio, Message, Transfer
from etd_hal.selection import Selection
from etd_hal.switch_shadow import Approval
from stepped_board import SteppedBoard, stepped_board
from trace_decoder import Phase, decode

pytestmark = pytest.mark.slow

BOARD = "etactilekit-hv513"
OUTPUT = 3
#: One code of this board's DAC, about: whatever flips down to it is below the approval.
CURRENT_UA = 2_000
WIDTH_US = 100
#: IEC 60601-2-10 asks 20 % of duration and amplitude; the guard's own worst case is reckoned so.
TOLERANCE = 1.2


class FlippingGpio:
    """Inverts one change, counted through all calls; -1 inverts none."""

    def __init__(self, gpio: Gpio, flipped: int) -> None:
        self._gpio = gpio
        self._flipped = flipped
        self.changes = 0

    def set(self, changes: Changes) -> None:
        wrong = []
        for line, value in changes:
            wrong.append((line, 1 - value if self.changes == self._flipped else value))
            self.changes += 1
        self._gpio.set(tuple(wrong))

    def get(self, line: int) -> int:
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self._gpio.edges()


class Bench:
    """A board that may fire, with all outputs off."""

    def __init__(self) -> None:
        self.stepped: SteppedBoard = stepped_board(BOARD)
        backend = self.stepped.backend
        machine = load_machine(find("machines", "pi4"))
        self.board = Board(
            self.stepped.board, machine, backend.codec, backend.spi, backend.gpio, backend.clock
        )
        assert self.board.safe_off() == ()
        self.board.calibrate()
        self.board.guard.permit(10_000)
        self.selection: Selection = self.board.selection(OUTPUT, None)

    def approve(self) -> None:
        self.board.guard.approve(
            Approval(self.selection.source(True), self.selection.ground(True), CURRENT_UA, WIDTH_US)
        )

    def phases(self) -> list[Phase]:
        """What reached the wires; afterwards the board is safe again."""
        phases = decode(self.stepped.trace_lines())
        assert self.board.safe_off() == ()
        assert self.stepped.fake.violations == []
        return phases


def flips(message: Message) -> Iterator[Message]:
    """Every message that is one bit away: words, delays (8 bits of them), chip select."""
    for index, transfer in enumerate(message.transfers):
        for wrong in _flips_of(transfer):
            others = message.transfers
            yield Message((*others[:index], wrong, *others[index + 1 :]))


def _flips_of(transfer: Transfer) -> Iterator[Transfer]:
    word = int.from_bytes(transfer.tx, "big")
    for bit in range(8 * len(transfer.tx)):
        tx = (word ^ 1 << bit).to_bytes(len(transfer.tx), "big")
        yield dataclasses.replace(transfer, tx=tx)
    for bit in range(8):
        yield dataclasses.replace(transfer, delay_us=transfer.delay_us ^ 1 << bit)
    yield dataclasses.replace(transfer, cs_change=not transfer.cs_change)


def check_harmless(bench: Bench) -> None:
    """Nothing at all, or one phase, through the approved outputs, within what was approved."""
    phases = bench.phases()
    assert len(phases) <= 1
    for phase in phases:
        assert phase.electrode == OUTPUT
        assert phase.is_anodic
        assert len(phase.ground) == bench.stepped.board.switch.outputs - 1
        assert phase.current_ua <= CURRENT_UA
        assert phase.width_us <= WIDTH_US * TOLERANCE


@pytest.mark.parametrize("width_us", [20, WIDTH_US])
def test_a_flipped_bit_in_the_message_is_refused_or_harmless(width_us: int) -> None:
    bench = Bench()
    pulse = bench.board.pulse(CURRENT_UA, width_us)
    refused = 0
    tried = list(flips(pulse.message))
    for wrong in tried:
        bench = Bench()
        bench.board.prepare(bench.selection, whole=True)
        bench.board.connect(bench.selection, True)
        bench.approve()
        try:
            bench.board.guard.spi.transfer(wrong)
        except GuardRefusal:
            refused += 1
        except BusError as error:
            pytest.fail(f"the kernel would have been asked for what is invalid: {error}")
        check_harmless(bench)
    # Most of them: each word has 2 command bits, 2 low ones, and the code's bits that are 0.
    assert refused > len(tried) / 3


def select_and_fire(bench: Bench, flipped: int) -> int:
    """The whole way of one pulse with one change inverted; how many changes there were."""
    gpio = FlippingGpio(bench.board.guard.gpio, flipped)
    lines = bench.stepped.board.switch.lines
    switch = HalfBridgeSwitch(gpio, lines, bench.stepped.board.switch.outputs, None)  # type: ignore[arg-type]
    switch.reset()
    # Twice: filled as a whole, then by as few clocks as will do.
    for output, whole in ((OUTPUT - 1, True), (OUTPUT, False)):
        switch.prepare(bench.board.selection(output, None), whole)
    switch.connect(bench.selection, True)
    bench.approve()
    bench.board.guard.spi.transfer(bench.board.pulse(CURRENT_UA, WIDTH_US).message)
    return gpio.changes


def test_a_flipped_line_on_the_way_to_a_pulse_is_refused_or_harmless() -> None:
    bench = Bench()
    count = select_and_fire(bench, -1)
    assert len(bench.phases()) == 1
    refused = 0
    for flipped in range(count):
        bench = Bench()
        try:
            select_and_fire(bench, flipped)
        except GuardRefusal:
            refused += 1
        check_harmless(bench)
    assert refused > count / 3


@pytest.mark.parametrize("polarity", [True, False])
def test_a_flipped_polarity_or_blanking_between_two_phases_is_refused(polarity: bool) -> None:
    for line, value in itertools.product(("POL", "BL"), (0, 1)):
        bench = Bench()
        number = bench.stepped.board.used_lines()[line]
        bench.board.prepare(bench.selection, whole=True)
        bench.board.connect(bench.selection, polarity)
        bench.approve()
        is_as_approved = polarity if line == "POL" and value == 1 else False
        is_as_approved |= polarity and line == "BL" and value == 1
        try:
            bench.board.guard.gpio.set(((number, value),))
            bench.board.guard.spi.transfer(bench.board.pulse(CURRENT_UA, WIDTH_US).message)
        except GuardRefusal:
            assert not is_as_approved
        check_harmless(bench)
