"""The one who watches the message under way, from beside."""

from __future__ import annotations

import pytest

from engine_parts import machine_file
from etd.engine.stopper import Stopper
from etd.errors import BoardFault, BusError, GuardRefusal
from etd_hal.board import OVERDUE_NS, Board
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.faults import SpiStall
from stepped_board import SteppedBoard, stepped_board

MS = 1_000_000
BL = 23


class StallingClock:
    """A clock whose thread is taken off the processor at one of its readings, for 10 ms."""

    def __init__(self, clock: SteppedClock) -> None:
        self._clock = clock
        self.readings = 0
        self.stalls_at: int | None = None

    def now_ns(self) -> int:
        is_stalled = self.readings == self.stalls_at
        self.readings += 1
        if is_stalled:
            self._clock.spend(10 * MS)
        return self._clock.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._clock.sleep_until_ns(deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self._clock.doze_until_ns(deadline_ns)


class Scene:
    """A board that is about to fire at output 3, and a stopper that looks twice a millisecond."""

    def __init__(self, name: str = "kajimoto-hv507", *, stall_us: int = 0) -> None:
        self.made: SteppedBoard = stepped_board(name)
        backend, clock = self.made.backend, self.made.clock
        #: The clock of the thread that fires.
        self.scan_clock = StallingClock(clock)
        self.board = Board(
            self.made.board, machine_file(), backend.spi, backend.gpio, self.scan_clock
        )
        assert self.board.safe_off() == ()
        self.board.calibrate()
        self.board.supply_on()
        self.board.guard.permit(3_000)
        self.selection = self.board.selection(3, None)
        self.board.prepare(self.selection, whole=True)
        self.board.connect(self.selection, True)
        self.stopper = Stopper(self.board, clock)
        self.looked_from_ns = clock.now_ns()
        if stall_us:
            self.made.fake.world.put_in(SpiStall(stall_us))

    def look_all_the_time(self, for_ms: int) -> None:
        for step in range(2 * for_ms):
            self.made.clock.at(self.looked_from_ns + step * MS // 2, self.stopper.look)

    def fire(self, is_anodic: bool = True) -> None:
        self.board.fire(self.board.pulse(2_000, 100), self.selection, is_anodic, 2_000, 100)

    def blanked_ns(self) -> int:
        """When BL fell, after the visit had begun."""
        return min(self.blankings_ns())

    def blankings_ns(self) -> list[int]:
        return [
            one["t_ns"]
            for one in self.made.events("gpio")
            if one["line"] == BL and not one["value"] and one["t_ns"] > self.looked_from_ns
        ]


def test_a_message_in_time_is_left_alone() -> None:
    scene = Scene()
    scene.look_all_the_time(5)
    scene.fire()
    assert not scene.stopper.has_acted


def test_a_message_that_is_late_by_less_than_a_millisecond_is_left_alone() -> None:
    scene = Scene(stall_us=900)
    scene.look_all_the_time(5)
    scene.fire()
    assert not scene.stopper.has_acted


def test_an_overdue_message_has_its_outputs_cut_off_while_it_still_stands() -> None:
    scene = Scene(stall_us=10_000)
    scene.look_all_the_time(20)
    scene.fire()
    assert scene.stopper.has_acted
    overdue_ns = scene.looked_from_ns + scene.board.pulse(2_000, 100).planned_ns + OVERDUE_NS
    assert overdue_ns <= scene.blanked_ns() <= overdue_ns + MS
    assert OVERDUE_NS == MS


def test_the_skin_gets_nothing_more_once_it_has_acted() -> None:
    scene = Scene(stall_us=50_000)
    scene.look_all_the_time(60)
    scene.fire()
    given_pc = scene.made.body.absolute_charge_pc(3)
    assert given_pc < 2_000 * 2_500, "2 mA for the two milliseconds until it acts, and no more"


def test_it_acts_once() -> None:
    scene = Scene(stall_us=10_000)
    scene.look_all_the_time(20)
    scene.fire()
    assert len(scene.blankings_ns()) == 1


def test_nothing_is_overdue_while_no_message_is_under_way() -> None:
    scene = Scene()
    scene.fire()
    scene.made.clock.spend(500 * MS)
    scene.stopper.look()
    assert not scene.stopper.has_acted


def test_a_message_that_was_refused_is_not_waited_for() -> None:
    scene = Scene()
    scene.board.guard.permit(0)
    with pytest.raises(GuardRefusal):
        scene.fire()
    scene.made.clock.spend(500 * MS)
    scene.stopper.look()
    assert not scene.stopper.has_acted


def test_lines_that_are_gone_do_not_end_the_stopper() -> None:
    scene = Scene(stall_us=10_000)
    # Within the message: before it the driver takes its time to lay it out.
    scene.made.clock.at(scene.looked_from_ns + MS, scene.made.fake.release)
    scene.look_all_the_time(20)
    scene.fire()
    assert scene.stopper.has_acted
    with pytest.raises(BusError):
        scene.board.blank_now()


@pytest.mark.parametrize("reading", range(3))
def test_what_the_thread_loses_outside_of_the_message_is_not_the_messages(reading: int) -> None:
    """A stall in the guard's own work, of which each reading of the clock stands for a part."""
    scene = Scene()
    scene.look_all_the_time(40)
    scene.scan_clock.stalls_at = scene.scan_clock.readings + reading
    scene.fire()
    assert scene.made.clock.now_ns() > scene.looked_from_ns + 10 * MS, "the thread has stalled"
    assert not scene.stopper.has_acted


@pytest.mark.parametrize("name", ["kajimoto-hv507", "reference-hv507", "feetthrough-relay"])
def test_a_second_phase_is_not_fired_behind_a_cut(name: str) -> None:
    scene = Scene(name, stall_us=10_000)
    scene.look_all_the_time(20)
    with pytest.raises(BoardFault, match="cut off"):  # noqa: PT012 - whichever refuses first
        scene.fire()
        scene.board.flip(scene.selection, False)
        scene.fire(False)
    assert scene.stopper.has_acted
    assert scene.made.fake.violations == []
    assert len(scene.made.events("body")) == 1
