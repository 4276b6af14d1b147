"""The stopper's process on real lines: what it cuts, what becomes of the lines after a kill, and
how the processes beside a scan begin and end.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import gpiod  # noqa: TID251
import pytest

import kernel_trace
from etd_hal.board import Board
from etd_hal.compose import open_linux
from etd_hal.cutlatch import CUTS, DUE_NS, SEEN
from etd_hal.errors import BusError
from etd_hal.linesetup import line_setup
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.gpio import find_chip, holders, levels_as_they_are
from etd_hal.linux.side_process import SideProcess
from guest_board import BARE_BOARD as BOARD
from guest_board import IS_VIRTUAL_TIME, MACHINE, above_the_engine, report, set_parameter

CLOCK = LinuxClock()
LINES = BOARD.used_lines()
POL, BL = LINES["POL"], LINES["BL"]
#: Connected, as between `connect` and the end of a message.
LIVE = ((POL, 1), (BL, 1))
#: Of a scan's stopper.
PRIORITY = 81
CUT_WITHIN_MS = 5.0
#: The kernel's, for the memory of a process that has loaded all of pytest: 20 ms where the
#: processor is emulated.
FREE_WITHIN_MS = 50.0
MS = 1_000_000


@pytest.fixture(autouse=True)
def nobody_answers() -> Iterator[None]:
    set_parameter("alone", 1)
    kernel_trace.begin()
    yield
    set_parameter("alone", 0)


@dataclass(frozen=True)
class Driving:
    """A process that has the lines, the outputs un-blanked, and a stopper; it does nothing more."""

    pid: int
    stopper: int

    def end(self, number: int) -> int:
        """By a signal; returns when."""
        ended_ns = CLOCK.now_ns()
        os.kill(self.pid, number)
        return ended_ns


@contextmanager
def driving(*, is_overdue: bool) -> Iterator[Driving]:
    """`is_overdue`: its message will be, and it never looks at it again."""
    told, telling = os.pipe()
    pid = os.fork()
    if pid == 0:
        _drive(telling, is_overdue)
    os.close(telling)
    with os.fdopen(told) as said:
        made = Driving(pid, int(said.readline()))
    try:
        yield made
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


def _drive(telling: int, is_overdue: bool) -> None:
    """In the process itself; it never returns."""
    try:
        backend = open_linux(BOARD, MACHINE)
        board = Board(BOARD, MACHINE, backend.codec, backend.spi, backend.gpio, backend.clock)
        assert backend.beside is not None
        stopper = backend.beside.stopper(board.cut, board.safe_changes, None, PRIORITY, None)
        assert isinstance(stopper, SideProcess)
        assert stopper.refusals == ()
        stopper.watch(True)
        backend.gpio.set(LIVE)
        os.write(telling, f"{stopper.pid}\n".encode())
        if is_overdue:
            board.cut.words[DUE_NS] = backend.clock.now_ns()
        while True:
            signal.pause()
    finally:
        os._exit(1)


def changes(pid: int) -> list[tuple[int, ...]]:
    """(us, line, level) of every line that a process set."""
    events = [event for event in kernel_trace.events() if event.name == "rig_line"]
    return [
        (event.t_us, *(int(word) for word in event.rest.split()))
        for event in events
        if event.pid == pid
    ]


def test_it_cuts_for_a_process_that_hangs_and_goes_on_until_that_is_seen() -> None:
    with driving(is_overdue=True) as made:
        CLOCK.doze_until_ns(CLOCK.now_ns() + 200 * MS)
        told = changes(made.stopper)
        chip = find_chip(BOARD.gpio_chip_labels)
        assert set(holders(chip, (POL, BL))) == {POL, BL}, "they are held all the while"
    levels = [(line, level) for _, line, level in told]
    assert levels[:2] == [(POL, 1), (BL, 0)]
    assert len(levels) >= (200 if IS_VIRTUAL_TIME else 4), "it repeats its call"
    assert set(levels) == {(POL, 1), (BL, 0)}, "it sets nothing else"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_lines_are_cut_and_free_soon_after_the_driving_process_was_killed(number: int) -> None:
    """For a new start, and for what makes the board safe."""
    chip = find_chip(BOARD.gpio_chip_labels)
    with driving(is_overdue=False) as made:
        assert changes(made.stopper) == []
        with above_the_engine(), gpiod.Chip(str(chip)) as watched:
            watched.watch_line_info(BL)
            killed_ns = made.end(number)
            released = watched.read_info_event()
            assert released.event_type is gpiod.InfoEvent.Type.LINE_RELEASED
            free_ms = (released.timestamp_ns - killed_ns) / MS
        assert holders(chip, (POL, BL)) == {}
        told = changes(made.stopper)
        assert [(line, level) for _, line, level in told] == [(POL, 1), (BL, 0)]
    levels = levels_as_they_are(chip, line_setup(BOARD))
    assert (levels[POL], levels[BL]) == (1, 0)
    cut_ms = told[-1][0] / 1_000 - killed_ns / MS
    report(f"from a kill to outputs that are cut {cut_ms:.1f} ms, to free lines {free_ms:.1f} ms")
    assert cut_ms < CUT_WITHIN_MS
    assert free_ms < FREE_WITHIN_MS


def test_what_asks_the_whole_service_to_end_leaves_the_stopper_at_work() -> None:
    with driving(is_overdue=False) as made:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGABRT):
            os.kill(made.stopper, number)
        CLOCK.doze_until_ns(CLOCK.now_ns() + 50 * MS)
        os.kill(made.stopper, 0)
        assert changes(made.stopper) == []


def test_a_cut_is_seen_by_the_driving_side_whose_next_call_is_undone() -> None:
    backend = open_linux(BOARD, MACHINE)
    board = Board(BOARD, MACHINE, backend.codec, backend.spi, backend.gpio, backend.clock)
    assert backend.beside is not None
    stopper = backend.beside.stopper(board.cut, board.safe_changes, None, None, None)
    try:
        stopper.watch(True)
        board.cut.words[DUE_NS] = CLOCK.now_ns()
        until_ns = CLOCK.now_ns() + 5_000 * MS
        while not board.cut.is_cut:
            CLOCK.doze_until_ns(CLOCK.now_ns() + MS)
            assert CLOCK.now_ns() < until_ns
        with pytest.raises(Exception, match="cut off by the stopper"):
            board.guard.gpio.set(LIVE)
        assert board.cut.words[SEEN] == board.cut.words[CUTS] == 1
        assert (backend.gpio.get(POL), backend.gpio.get(BL)) == (1, 0)
        board.cut.words[DUE_NS] = 0
        assert board.safe_off() == ()
        assert not board.cut.is_cut
    finally:
        stopper.end()
        backend.close()


def test_what_is_not_granted_is_told_with_the_name_of_the_process() -> None:
    backend = open_linux(BOARD, MACHINE)
    board = Board(BOARD, MACHINE, backend.codec, backend.spi, backend.gpio, backend.clock)
    assert backend.beside is not None
    only = next(iter(os.sched_getaffinity(0)))
    stopper = backend.beside.stopper(board.cut, board.safe_changes, None, None, only)
    try:
        (told,) = stopper.refusals
    finally:
        stopper.end()
        backend.close()
    assert told.startswith("the stopper: a core other than the scan's (")


def test_one_that_does_not_come_up_is_an_error() -> None:
    with pytest.raises(BusError, match=r"the absent failed .gone.: it ended") as raised:
        _ = SideProcess("the absent", "no_such_module", ()).refusals
    assert raised.value.kind == "gone"


def test_one_that_does_not_end_is_killed_and_hears_no_more() -> None:
    sleeper = SideProcess("the sleeper", "endless", ())
    assert sleeper.refusals == ("the sleeper: nothing was granted",)
    begun_ns = CLOCK.now_ns()
    sleeper.end()
    assert CLOCK.now_ns() - begun_ns > 1_900 * MS
    sleeper.watch(True)
    with pytest.raises(ProcessLookupError):
        os.kill(sleeper.pid, 0)
