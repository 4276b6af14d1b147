"""The process that `etd selftest` puts in the engine's place, when nobody kills it.

That its lines fall back when it is killed is shown by check_selftest.py; what is killed cannot tell
which of its lines of code ran. Here it ends by itself.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

import kernel_trace
from etd_hal.boardfile import BoardFile
from etd_hal.errors import BusError
from etd_hal.linesetup import line_setup
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.gpio import find_chip, open_gpio
from etd_hal.linux.kill_test_process import LentGpio, LinuxKillTestProcess
from etd_hal.linux.opening import open_lines
from etd_hal.linux.realtime import perish_with
from etd_hal.ports import LineSetup
from guest_board import BARE_BOARD, BOARD, set_parameter

CLOCK = LinuxClock()
#: It gives up after this.
LONGEST_S = 10
#: What no test expects of a process that ends in peace.
NO_PARENT = 7


@pytest.fixture(autouse=True)
def nobody_answers() -> Iterator[None]:
    set_parameter("alone", 1)
    kernel_trace.begin()
    yield
    set_parameter("alone", 0)


@contextmanager
def kill_test_process(board: BoardFile) -> Iterator[tuple[LinuxKillTestProcess, LentGpio]]:
    """Not begun yet; at the end the lines are free."""
    setup = line_setup(board)
    lent = LentGpio(open_lines(board, setup), lambda: open_lines(board, setup))
    kill_test = LinuxKillTestProcess(board, setup, lent)
    try:
        yield kill_test, lent
    finally:
        kill_test.step_back()
        lent.close()


def ended(kill_test: LinuxKillTestProcess) -> tuple[int, int, float]:
    """Wait for its end: which process it was, its status, and after how many seconds."""
    begun_ns = CLOCK.now_ns()
    pid, kill_test.pid = kill_test.pid or 0, None
    _, status = os.waitpid(pid, 0)
    return pid, os.waitstatus_to_exitcode(status), (CLOCK.now_ns() - begun_ns) / 1e9


def changes(pid: int) -> list[tuple[int, int]]:
    """Every line that a process set, and to what."""
    mine = (
        event for event in kernel_trace.events() if (event.pid, event.name) == (pid, "rig_line")
    )
    return [(int(line), int(level)) for line, level in (event.rest.split() for event in mine)]


def test_it_keeps_the_supply_on_and_the_heart_beating_and_ends_of_itself() -> None:
    enable, heartbeat = BOARD.guards.hv_enable, BOARD.guards.heartbeat
    assert enable != "absent"
    assert heartbeat != "absent"
    with kill_test_process(BOARD) as (kill_test, lent):
        kill_test.take_over()
        pid, status, lived_s = ended(kill_test)
        kill_test.step_back()
        assert lent.edges() == ()
    assert status == 1
    assert LONGEST_S - 0.1 < lived_s < LONGEST_S + 0.1
    outputs = list(line_setup(BOARD).outputs)
    told = changes(pid)
    requested, switched_on, beats = (
        told[: len(outputs)],
        told[len(outputs)],
        told[len(outputs) + 1 :],
    )
    assert requested == outputs
    assert switched_on == (enable.line, enable.on)
    assert beats == [(heartbeat.line, 1 - index % 2) for index in range(len(beats))]
    # Five of them in the monostable's window.
    assert len(beats) * heartbeat.window_ms / 5 == pytest.approx(LONGEST_S * 1_000, rel=0.02)


def test_on_a_board_without_supply_line_and_heartbeat_it_only_holds_the_lines() -> None:
    with kill_test_process(BARE_BOARD) as (kill_test, _):
        kill_test.take_over()
        pid, status, lived_s = ended(kill_test)
    assert (status, round(lived_s)) == (1, LONGEST_S)
    assert changes(pid) == list(line_setup(BARE_BOARD).outputs)


def test_one_that_cannot_have_the_lines_is_told_of() -> None:
    taken = LineSetup(outputs=((BOARD.used_lines()["DATA"], 0),), consumer="somebody")
    with kill_test_process(BOARD) as (kill_test, lent):
        lent.give_up()
        somebody = open_gpio(find_chip(BOARD.gpio_chip_labels), taken)
        try:
            with pytest.raises(BusError, match="does not come up"):
                kill_test.take_over()
            with pytest.raises(BusError, match="looking at released lines") as raised:
                kill_test.levels()
        finally:
            somebody.close()
        assert raised.value.kind == "busy"
        kill_test.step_back()
        assert not lent.is_lent


def test_one_whose_parent_has_gone_in_between_does_not_begin() -> None:
    pid = os.fork()
    if pid == 0:
        try:
            perish_with(os.getpid())
        except ProcessLookupError:
            os._exit(NO_PARENT)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == NO_PARENT
