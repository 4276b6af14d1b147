"""The one who watches the message under way, from beside."""

from __future__ import annotations

import threading
from collections.abc import Callable
from itertools import pairwise

import pytest

from board_rig import fire_phase
from engine_parts import machine_file
from etd.engine.stopper import SILENT_NS, StopperLiveness, StopperThread
from etd.protocol.errors import BoardFault, BusError, GuardRefusal
from etd_hal.board import Board
from etd_hal.cutlatch import CUTS, LOOKED_NS
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.faults import SpiStall
from etd_hal.ports import Changes, Clock, Edge, Gpio, Message, Spi
from etd_hal.stopper import OVERDUE_NS, Stopper
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


class CalledGpio:
    """Lines, and what happens before each of their calls."""

    def __init__(self, gpio: Gpio) -> None:
        self._gpio = gpio
        self.before: Callable[[], None] = lambda: None

    def set(self, changes: Changes) -> None:
        self.before()
        self._gpio.set(changes)

    def get(self, line: int) -> int:
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self._gpio.edges()


def stopper_of(board: Board, clock: Clock) -> Stopper:
    """As the engine's thread has it."""
    return Stopper(board.cut.words, clock.now_ns, board.blank_now)


def looked_ns(board: Board) -> int:
    """When the stopper's last check began."""
    return board.cut.words[LOOKED_NS]


class Scene:
    """A board that is about to fire at output 3, and a stopper that looks twice a millisecond."""

    def __init__(self, name: str = "kajimoto-hv507", *, stall_us: int = 0) -> None:
        self.made: SteppedBoard = stepped_board(name)
        backend, clock = self.made.backend, self.made.clock
        #: The clock of the thread that fires.
        self.scan_clock = StallingClock(clock)
        self.gpio = CalledGpio(backend.gpio)
        self.board = Board(
            self.made.board, machine_file(), backend.codec, backend.spi, self.gpio, self.scan_clock
        )
        assert self.board.safe_off() == ()
        self.board.calibrate()
        self.board.supply_on()
        self.board.guard.permit(3_000)
        self.selection = self.board.selection(3, None)
        self.board.prepare(self.selection, whole=True)
        self.board.connect(self.selection, True)
        self.stopper = stopper_of(self.board, clock)
        self.looked_from_ns = clock.now_ns()
        if stall_us:
            self.made.fake.world.put_in(SpiStall(stall_us))

    def look_all_the_time(self, for_ms: int) -> None:
        for step in range(2 * for_ms):
            self.made.clock.at(self.looked_from_ns + step * MS // 2, self.stopper.check)

    def fire(self, is_anodic: bool = True) -> None:
        fire_phase(self.board, self.board.pulse(2_000, 100), self.selection, is_anodic, 2_000, 100)

    def blanked_ns(self) -> int:
        """When BL fell, after the visit had begun."""
        return min(self.blankings_ns())

    def blankings_ns(self) -> list[int]:
        return [
            entry["t_ns"]
            for entry in self.made.events("gpio")
            if entry["line"] == BL and not entry["value"] and entry["t_ns"] > self.looked_from_ns
        ]


def test_a_message_in_time_is_left_alone() -> None:
    scene = Scene()
    scene.look_all_the_time(5)
    scene.fire()
    assert not scene.board.cut.is_cut


def test_a_message_that_is_late_by_less_than_a_millisecond_is_left_alone() -> None:
    scene = Scene(stall_us=900)
    scene.look_all_the_time(5)
    scene.fire()
    assert not scene.board.cut.is_cut


def test_an_overdue_message_has_its_outputs_cut_off_while_it_still_stands() -> None:
    scene = Scene(stall_us=10_000)
    scene.look_all_the_time(20)
    scene.fire()
    assert scene.board.cut.is_cut
    overdue_ns = scene.looked_from_ns + scene.board.pulse(2_000, 100).planned_ns + OVERDUE_NS
    assert overdue_ns <= scene.blanked_ns() <= overdue_ns + MS
    assert OVERDUE_NS == MS


def test_the_skin_gets_nothing_more_once_it_has_acted() -> None:
    scene = Scene(stall_us=50_000)
    scene.look_all_the_time(60)
    scene.fire()
    given_pc = scene.made.body.absolute_charge_pc(3)
    assert given_pc < 2_000 * 2_500, "2 mA for the two milliseconds until it acts, and no more"


def test_it_counts_a_cut_once_and_repeats_its_call_until_the_cut_was_seen() -> None:
    """The driving side sees it with its next call."""
    scene = Scene(stall_us=10_000)
    scene.look_all_the_time(20)
    scene.fire()
    assert scene.board.cut.words[CUTS] == 1
    repeated_ns = scene.blankings_ns()
    assert len(repeated_ns) > 10
    assert {after - before for before, after in pairwise(repeated_ns)} == {MS // 2}
    with pytest.raises(BoardFault, match="cut off"):
        scene.board.discharge()
    seen = len(scene.blankings_ns())
    scene.made.clock.spend(100 * MS)
    assert len(scene.blankings_ns()) == seen
    assert scene.board.cut.words[CUTS] == 1


def test_a_second_message_that_is_overdue_is_cut_as_well() -> None:
    """Without any word from the driving side in between, but that the board was made safe."""
    scene = Scene(stall_us=10_000)
    scene.look_all_the_time(200)
    scene.fire()
    assert scene.board.safe_off() == ()
    assert not scene.board.cut.is_cut
    scene.board.supply_on()
    scene.board.guard.permit(3_000)
    scene.board.prepare(scene.selection, whole=True)
    scene.board.connect(scene.selection, True)
    scene.made.fake.world.put_in(SpiStall(10_000))
    scene.fire()
    assert scene.board.cut.is_cut
    assert scene.board.cut.words[CUTS] == 2


def test_a_cut_that_comes_while_the_board_is_made_safe_is_not_over_with_that() -> None:
    """It was counted behind the call that blanks."""
    scene = Scene()
    scene.gpio.before = lambda: scene.board.cut.words.__setitem__(CUTS, 1)
    assert scene.board.safe_off() == ()
    assert scene.board.cut.is_cut
    scene.gpio.before = lambda: None
    assert scene.board.safe_off() == ()
    assert not scene.board.cut.is_cut


def test_nothing_is_overdue_while_no_message_is_under_way() -> None:
    scene = Scene()
    scene.fire()
    scene.made.clock.spend(500 * MS)
    scene.stopper.check()
    assert not scene.board.cut.is_cut


def test_a_message_that_was_refused_is_not_waited_for() -> None:
    scene = Scene()
    scene.board.guard.permit(0)
    with pytest.raises(GuardRefusal):
        scene.fire()
    scene.made.clock.spend(500 * MS)
    scene.stopper.check()
    assert not scene.board.cut.is_cut


def test_lines_that_are_gone_do_not_end_the_stopper() -> None:
    scene = Scene(stall_us=10_000)
    # Within the message: before it the driver takes its time to lay it out.
    scene.made.clock.at(scene.looked_from_ns + MS, scene.made.fake.release)
    scene.look_all_the_time(20)
    scene.fire()
    assert scene.board.cut.is_cut
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
    assert not scene.board.cut.is_cut


@pytest.mark.parametrize("name", ["kajimoto-hv507", "reference-hv507", "feetthrough-relay"])
def test_a_second_phase_is_not_fired_behind_a_cut(name: str) -> None:
    scene = Scene(name, stall_us=10_000)
    scene.look_all_the_time(20)
    with pytest.raises(BoardFault, match="cut off"):  # noqa: PT012 - whichever refuses first
        scene.fire()
        scene.board.flip(scene.selection, False)
        scene.fire(False)
    assert scene.board.cut.is_cut
    assert scene.made.fake.violations == []
    assert len(scene.made.events("body")) == 1


# --- another thread's message ---------------------------------------------------------------------

#: Of real time; what is waited for takes none.
PATIENCE_S = 10.0


class HeldSpi:
    """A message goes out when the test lets it."""

    def __init__(self, spi: Spi) -> None:
        self._spi = spi
        self.is_held = False
        self.has_begun, self.may_end = threading.Event(), threading.Event()

    def prepare(self, message: Message) -> None:
        self._spi.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        if self.is_held:
            self.has_begun.set()
            assert self.may_end.wait(PATIENCE_S)
        return self._spi.transfer(message)


class CallingClock:
    """Its thread is taken off the processor in a reading, and the world goes on meanwhile."""

    def __init__(self, clock: SteppedClock, meanwhile: Callable[[], None]) -> None:
        self._clock = clock
        self._meanwhile = meanwhile

    def now_ns(self) -> int:
        self._meanwhile()
        return self._clock.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._clock.sleep_until_ns(deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self._clock.doze_until_ns(deadline_ns)


def test_a_message_that_ended_while_the_stopper_looked_is_not_overdue() -> None:
    """Where a machine is busy the stopper may lose 10 ms between the deadline and the time."""
    made = stepped_board("kajimoto-hv507")
    spi = HeldSpi(made.backend.spi)
    board = Board(
        made.board, machine_file(), made.backend.codec, spi, made.backend.gpio, made.clock
    )
    assert board.safe_off() == ()
    board.calibrate()
    board.guard.permit(2_000)
    selection = board.selection(3, None)
    board.prepare(selection)
    board.connect(selection, True)
    spi.is_held = True
    firing = threading.Thread(
        target=lambda: fire_phase(board, board.pulse(2_000, 100), selection, True, 2_000, 100)
    )

    def end_the_message() -> None:
        spi.may_end.set()
        firing.join(PATIENCE_S)
        made.clock.spend(10 * MS)

    stopper = stopper_of(board, CallingClock(made.clock, end_the_message))
    firing.start()
    assert spi.has_begun.wait(PATIENCE_S)
    stopper.check()
    assert not firing.is_alive()
    assert not board.cut.is_cut


# --- the thread -----------------------------------------------------------------------------------


def silence_of(board: Board, for_ms: int) -> StopperLiveness:
    """Woken at 1 s, and judged every millisecond since."""
    liveness = StopperLiveness(board.cut)
    liveness.begin(1_000 * MS)
    for step in range(1, for_ms + 1):
        liveness.judge((1_000 + step) * MS)
    return liveness


def test_a_thread_that_is_awake_leaves_the_time_of_its_looks() -> None:
    scene = Scene()
    looked = threading.Event()
    stopper = stopper_of(scene.board, CallingClock(scene.made.clock, looked.set))
    thread = StopperThread(stopper)
    thread.start()
    thread.watch(True)
    assert looked.wait(PATIENCE_S)
    thread.end()
    assert not thread.is_alive()
    assert looked_ns(scene.board) == scene.made.clock.now_ns()


def test_a_thread_that_hangs_in_its_look_leaves_no_time() -> None:
    scene = Scene()
    hangs, may_go_on = threading.Event(), threading.Event()

    def hang() -> None:
        hangs.set()
        assert may_go_on.wait(PATIENCE_S)

    stopper = stopper_of(scene.board, CallingClock(scene.made.clock, hang))
    thread = StopperThread(stopper)
    thread.start()
    thread.watch(True)
    assert hangs.wait(PATIENCE_S)
    liveness = silence_of(scene.board, for_ms=600)
    assert not liveness.has_looked
    assert liveness.problem is not None
    assert liveness.problem.startswith("the stopper made no check for 600 ms")
    may_go_on.set()
    thread.end()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_has_ended_leaves_no_time() -> None:
    scene = Scene()

    def end() -> None:
        raise RuntimeError("the clock is gone")

    stopper = stopper_of(scene.board, CallingClock(scene.made.clock, end))
    thread = StopperThread(stopper)
    thread.start()
    thread.watch(True)
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert silence_of(scene.board, for_ms=600).problem is not None


def test_a_cut_that_hangs_is_marked_and_leaves_no_time() -> None:
    """Its GPIO call does not return: what it was about to do is known all the same."""
    scene = Scene(stall_us=10_000)
    marks: list[tuple[bool, int]] = []

    def hanging() -> None:
        marks.append((scene.board.cut.is_cut, looked_ns(scene.board)))

    scene.gpio.before = hanging
    scene.made.clock.at(scene.looked_from_ns + 3 * MS, scene.stopper.check)
    scene.fire()
    assert marks == [(True, 0)]
    assert looked_ns(scene.board) == scene.looked_from_ns + 3 * MS


def test_a_stopper_is_silent_from_its_last_look_on_and_alive_with_the_next() -> None:
    scene = Scene()
    liveness = StopperLiveness(scene.board.cut)
    begun_ns = scene.made.clock.now_ns()
    liveness.begin(begun_ns)
    scene.stopper.check()
    assert liveness.has_looked
    for step in range(SILENT_NS // MS + 1):
        liveness.judge(begun_ns + step * MS)
        assert liveness.problem is None
    liveness.judge(begun_ns + SILENT_NS + MS)
    assert liveness.problem is not None
    scene.made.clock.spend(SILENT_NS + 2 * MS)
    scene.stopper.check()
    liveness.judge(scene.made.clock.now_ns())
    assert liveness.problem is None


def test_time_in_which_the_scan_thread_did_not_look_either_is_not_silence() -> None:
    scene = Scene()
    liveness = StopperLiveness(scene.board.cut)
    liveness.begin(1_000 * MS)
    liveness.judge(1_001 * MS)
    liveness.judge(61_001 * MS)
    assert liveness.problem is None
    assert liveness.silent_ns < 20 * MS
