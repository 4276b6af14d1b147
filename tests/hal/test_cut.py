"""The stopper's cut, wherever it falls: what is cut stays cut until the board is made safe.

A cut can come between any two steps of the thread that drives the board: before one of its port
calls, behind it, or in a message that stands still. Each is tried at each call of each kind of
visit.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from board_rig import fire_phase, machine_file
from etd_body.interface import Side
from etd_hal.board import Board
from etd_hal.cutlatch import CUTS, DUE_NS
from etd_hal.errors import BoardFault, BusError
from etd_hal.fake.faults import SpiError, SpiStall
from etd_hal.ports import Changes, Edge, Gpio, Message, Spi
from etd_hal.selection import Selection
from stepped_board import SteppedBoard, stepped_board

pytestmark = pytest.mark.slow

BOARDS = ["reference-hv507", "kajimoto-hv507", "feetthrough-relay"]
RELAYS = "feetthrough-relay"
KINDS = [(True,), (True, False), (False, True)]
CURRENT_UA, WIDTH_US = 1_000, 100
#: A GPIO call of the fake takes less.
CALL_NS = 5_000
When = Literal["before", "behind"]
Said = TypeVar("Said")


@dataclass
class Interrupted:
    """The ports of a thread that another one comes between, at the call `at` (the first is 0)."""

    spi: Spi
    gpio: Gpio
    #: Calls that move these alone are not counted: behind a closed latch shifting changes nothing.
    shifting: frozenset[int]
    at: int | None = None
    when: When = "before"
    interrupt: Callable[[], None] = lambda: None
    calls: int = 0
    #: Which call it was: SPI or GPIO.
    was_message: bool | None = field(default=None, init=False)

    def prepare(self, message: Message) -> None:
        self.spi.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        return self._between(lambda: self.spi.transfer(message), is_message=True)

    def set(self, changes: Changes) -> None:
        if self.shifting.issuperset(line for line, _ in changes):
            self.gpio.set(changes)
        else:
            self._between(lambda: self.gpio.set(changes), is_message=False)

    def get(self, line: int) -> int:
        return self.gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self.gpio.edges()

    def _between(self, call: Callable[[], Said], *, is_message: bool) -> Said:
        is_here = self.calls == self.at
        self.calls += 1
        if not is_here:
            return call()
        self.at, self.was_message = None, is_message
        if self.when == "before":
            self.interrupt()
        answer = call()
        if self.when == "behind":
            self.interrupt()
        return answer


def cut_off(board: Board) -> None:
    """As the stopper does, once."""
    board.cut.words[CUTS] += 1
    board.blank_now()


class Scene:
    """A board that was brought to life as a daemon does it, and the ports it is driven through."""

    def __init__(self, name: str) -> None:
        self.made: SteppedBoard = stepped_board(name)
        backend = self.made.backend
        lines = self.made.board.used_lines()
        shifting = frozenset((lines["CLK"], lines["DATA"]))
        self.ports = Interrupted(backend.spi, backend.gpio, shifting)
        self.board = Board(
            self.made.board, machine_file(), backend.codec, self.ports, self.ports, self.made.clock
        )
        assert self.board.safe_off() == ()
        self.board.calibrate()
        self.power_up()
        #: When the cut was over.
        self.cut_ns: int | None = None

    def power_up(self) -> None:
        self.board.supply_on()
        self.board.guard.permit(CURRENT_UA)

    def cut(self) -> None:
        """As the stopper does."""
        cut_off(self.board)
        self.cut_ns = self.made.clock.now_ns()

    def select(self, output: int) -> Selection:
        return self.board.selection(output, None)

    def visit(self, phases: tuple[bool, ...]) -> None:
        """All that is done for one pulse, and the way to the next one."""
        board, selection, following = self.board, self.select(3), self.select(4)
        board.prepare(selection)
        board.connect(selection, phases[0])
        self.fire(selection, phases[0])
        for is_anodic in phases[1:]:
            board.flip(selection, is_anodic)
            self.fire(selection, is_anodic)
        board.discharge()
        board.prepare(following)
        board.connect(following, phases[0])
        board.discharge()
        board.release()

    def fire(self, selection: Selection, is_anodic: bool) -> None:
        pulse = self.board.pulse(CURRENT_UA, WIDTH_US)
        fire_phase(self.board, pulse, selection, is_anodic, CURRENT_UA, WIDTH_US)

    def fired(self) -> list[dict[str, Any]]:
        """Each phase since the cut that reached the skin, by the body's own account."""
        assert self.cut_ns is not None, "nothing was cut"
        events = [entry for entry in self.made.events("body") if entry["from_ns"] > self.cut_ns]
        return [entry for entry in events if entry["current_ua"]]

    def live_lines(self) -> list[dict[str, Any]]:
        """Each change since the cut that switches something on."""
        assert self.cut_ns is not None, "nothing was cut"
        lines = self.made.board.used_lines()
        live = {(lines.get("BL"), 1), (lines.get("POL"), 0), (lines.get("HV"), 1)}
        events = [entry for entry in self.made.events("gpio") if entry["t_ns"] > self.cut_ns]
        return [entry for entry in events if (entry["line"], entry["value"]) in live]

    def level(self, name: str) -> int:
        """Where a line was left."""
        line = self.made.board.used_lines()[name]
        events = self.made.events("gpio")
        return int(next(event["value"] for event in reversed(events) if event["line"] == line))

    def assert_dark(self) -> None:
        """Nothing is connected to the source, or the source has no supply; and it is at zero."""
        if self.made.board.name == RELAYS:
            assert self.level("HV") == 0
        else:
            assert (self.level("POL"), self.level("BL")) == (1, 0)
            assert set(self.made.fake.sides) == {Side.GROUND}
        assert self.made.fake.dac_code == 0

    def assert_all_refused(self) -> None:
        """Twice, since what was refused must leave nothing that passes the next time."""
        board, selection = self.board, self.select(1)
        steps: list[Callable[[], None]] = [
            lambda: board.connect(selection, True),
            lambda: board.flip(selection, False),
            lambda: board.flip(selection, True),
            lambda: board.guard.gpio.set(((self.made.board.used_lines()["LE"], 1),)),
        ]
        if not board.switch.can_choose_returns:
            # Relays do nothing when prepared.
            steps.append(lambda: board.prepare(selection, whole=True))
        if self.made.board.guards.hv_enable != "absent":
            steps.append(board.supply_on)
        for step in steps * 2:
            with pytest.raises(BoardFault, match="cut off by the stopper"):
                step()
            self.assert_dark()

    def assert_mended(self, phases: tuple[bool, ...]) -> None:
        """Made safe, it works as before."""
        assert self.board.safe_off() == ()
        self.power_up()
        before = len(self.made.events("body"))
        self.visit(phases)
        assert len(self.made.events("body")) == before + len(phases)
        assert self.board.safe_off() == ()


def calls_of(name: str, phases: tuple[bool, ...]) -> range:
    """Those of one visit, by number."""
    scene = Scene(name)
    before = scene.ports.calls
    scene.visit(phases)
    return range(scene.ports.calls - before)


@pytest.mark.parametrize("phases", KINDS)
@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("when", ["before", "behind"])
def test_a_cut_at_any_call_of_a_visit_stays(
    name: str, phases: tuple[bool, ...], when: When
) -> None:
    for at in calls_of(name, phases):
        scene = Scene(name)
        scene.ports.interrupt = scene.cut
        scene.ports.at, scene.ports.when = scene.ports.calls + at, when
        with pytest.raises(BoardFault, match="cut off by the stopper"):
            scene.visit(phases)
        scene.assert_dark()
        assert_nothing_came_on(scene, at)
        scene.assert_all_refused()
        scene.assert_mended(phases)


def assert_nothing_came_on(scene: Scene, at: int) -> None:
    """A call that another thread's cut came just before has its way for a moment: nothing in this
    process can keep it from that. It is undone by the next call, and no current is commanded yet.
    """
    live, ports, name = scene.live_lines(), scene.ports, scene.made.board.name
    assert scene.cut_ns is not None
    if ports.when == "before":
        assert all(entry["t_ns"] - scene.cut_ns < CALL_NS for entry in live), f"call {at}"
        assert all("BL 0 with POL 0" in violation for violation in scene.made.fake.violations)
    else:
        assert live == [], f"call {at}"
        assert scene.made.fake.violations == []
    # What the rail still holds can flow through relays that are closed, once.
    is_last_message = ports.was_message is True and ports.when == "before" and name == RELAYS
    assert len(scene.fired()) <= is_last_message, f"call {at}"


@settings(max_examples=30)
@given(
    name=st.sampled_from(BOARDS),
    phases=st.sampled_from(KINDS),
    offset_us=st.integers(0, 8_000),
    stall=st.one_of(st.none(), st.tuples(st.integers(1, 2), st.integers(0, 6))),
)
def test_a_cut_at_any_time_of_a_visit_stays(
    name: str, phases: tuple[bool, ...], offset_us: int, stall: tuple[int, int] | None
) -> None:
    """`stall`: one of its messages stands still for 4 ms, at one of its transfers."""
    scene = Scene(name)
    if stall is not None:
        scene.made.fake.world.put_in(SpiStall(4_000, *stall))
    scene.made.clock.at(scene.made.clock.now_ns() + offset_us * 1_000, scene.cut)
    with contextlib.suppress(BoardFault):
        scene.visit(phases)
    scene.made.clock.spend(8_000_000)
    scene.assert_dark()
    assert scene.live_lines() == []
    assert scene.made.fake.violations == []
    # Of a message that was under way relays carry on what the rail still holds.
    assert len(scene.fired()) <= (name == RELAYS and stall is not None)
    scene.assert_all_refused()
    scene.assert_mended(phases)


@pytest.mark.parametrize("name", BOARDS)
def test_a_message_is_not_sent_once_the_outputs_are_cut(name: str) -> None:
    scene = Scene(name)
    selection = scene.select(3)
    scene.board.prepare(selection)
    scene.board.connect(selection, True)
    scene.cut()
    before = len(scene.made.events("spi"))
    with pytest.raises(BoardFault, match="cut off by the stopper"):
        scene.fire(selection, True)
    assert len(scene.made.events("spi")) == before


def test_only_a_way_to_the_safe_state_that_was_completed_ends_a_cut() -> None:
    """A step of it fails: the lines, and then the DAC."""
    scene = Scene("reference-hv507")
    scene.cut()
    scene.ports.at, scene.ports.interrupt = scene.ports.calls, lines_fail
    assert scene.board.safe_off() == ("set on the lines failed (io)",)
    assert scene.board.cut.is_cut
    scene.made.fake.world.put_in(SpiError())
    assert len(scene.board.safe_off()) == 1
    assert scene.board.cut.is_cut
    scene.assert_all_refused()
    assert scene.board.safe_off() == ()
    assert not scene.board.cut.is_cut


def test_lines_that_fail_leave_the_mark_that_they_were_to_be_cut() -> None:
    scene = Scene("reference-hv507")
    selection = scene.select(3)
    scene.board.prepare(selection)
    scene.board.connect(selection, True)
    scene.ports.at, scene.ports.interrupt = scene.ports.calls, lines_fail
    with pytest.raises(BusError):
        cut_off(scene.board)
    with pytest.raises(BoardFault, match="cut off by the stopper"):
        scene.board.flip(selection, False)
    scene.assert_dark()


def test_a_board_that_nothing_cuts_is_driven_as_ever() -> None:
    scene = Scene("kajimoto-hv507")
    scene.visit((True, False))
    assert not scene.board.cut.is_cut
    assert scene.board.cut.words[DUE_NS] == 0


def lines_fail() -> None:
    raise BusError("io", "the lines", "set")
