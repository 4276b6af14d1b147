"""The process that a self-test kills: real processes, on lines that are a stand-in's."""

from __future__ import annotations

import os
import select
from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("gpiod", reason="gpiod is there on Linux only")

from etd_hal.boardfile import BoardFile
from etd_hal.errors import BusError
from etd_hal.linesetup import line_setup
from etd_hal.linux import kill_test_process
from etd_hal.linux.gpio import LinuxGpio, output_settings
from etd_hal.linux.kill_test_process import LentGpio, LinuxKillTestProcess
from etd_hal.ports import LineSetup
from gpiod_kernel import Kernel
from stepped_board import shipped_board

WITHIN_MS = 60_000
BOARD = shipped_board("reference-hv507")
SETUP = replace(line_setup(BOARD), inputs=())


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Kernel:
    kernel = Kernel()

    def open_lines(_: BoardFile, setup: LineSetup) -> LinuxGpio:
        return opened(kernel, setup)

    monkeypatch.setattr(kill_test_process, "open_lines", open_lines)
    return kernel


def opened(kernel: Kernel, setup: LineSetup = SETUP) -> LinuxGpio:
    wanted: dict[Any, Any] = dict(output_settings(setup).items())
    held = kernel.request_lines("chip", "etd", wanted)
    return LinuxGpio("chip", held, None, kernel.ioctl)


def has_ended(pid: int) -> bool:
    watched = os.pidfd_open(pid)
    try:
        poll = select.poll()
        poll.register(watched, select.POLLIN)
        return bool(poll.poll(WITHIN_MS))
    finally:
        os.close(watched)


def test_lines_are_given_up_to_it_and_taken_back_after_the_kill(kernel: Kernel) -> None:
    lent = LentGpio(opened(kernel), lambda: opened(kernel))
    kill_test = LinuxKillTestProcess(BOARD, SETUP, lent)
    kill_test.take_over()
    pid = kill_test.pid or 0
    try:
        assert lent.is_lent
        assert kernel.granted[0].fd == -1
        assert 0 < kill_test.kill() < WITHIN_MS
    finally:
        kill_test.step_back()
    assert kill_test.pid is None
    with pytest.raises(ChildProcessError):
        os.waitpid(pid, os.WNOHANG)
    assert not lent.is_lent
    lent.set(((BOARD.used_lines()["BL"], 1),))
    assert lent.get(BOARD.used_lines()["BL"]) == 1


def test_one_that_is_not_killed_ends_when_it_steps_back(kernel: Kernel) -> None:
    kill_test = LinuxKillTestProcess(BOARD, SETUP, LentGpio(opened(kernel), lambda: opened(kernel)))
    kill_test.take_over()
    pid = kill_test.pid or 0
    kill_test.step_back()
    assert kill_test.pid is None
    with pytest.raises(ChildProcessError):
        os.waitpid(pid, os.WNOHANG)


def test_one_that_cannot_have_the_lines_is_told(kernel: Kernel) -> None:
    lent = LentGpio(opened(kernel), lambda: opened(kernel))
    kernel.busy = {BOARD.used_lines()["POL"]}
    kill_test = LinuxKillTestProcess(BOARD, SETUP, lent)
    with pytest.raises(BusError, match="does not come up"):
        kill_test.take_over()
    kernel.busy = set()
    kill_test.step_back()
    assert not lent.is_lent


def test_it_does_not_outlive_its_parent(kernel: Kernel) -> None:
    told, telling = os.pipe()
    parent = os.fork()
    if parent == 0:
        kill_test = LinuxKillTestProcess(
            BOARD, SETUP, LentGpio(opened(kernel), lambda: opened(kernel))
        )
        kill_test.take_over()
        os.write(telling, str(kill_test.pid).encode())
        os._exit(0)
    pid = int(os.read(told, 20))
    try:
        assert has_ended(pid)
    except ProcessLookupError:
        pass  # ended, and waited for by init
    finally:
        os.waitpid(parent, 0)
        os.close(told)
        os.close(telling)
