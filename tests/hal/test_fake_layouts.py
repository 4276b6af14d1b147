"""The fake takes its time for a message that is not laid out yet, as the kernel's driver does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_hand import PAUSE, pulse
from board_process import running_board
from counted_readings import CountedTransfers
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.layouts import lay_out
from etd_hal.fake.machines import PI4
from etd_hal.fake.remote import open_remote
from etd_hal.linesetup import line_setup, spi_setup
from etd_hal.linux.spi import LinuxSpi
from etd_hal.ports import Clock, Message, Spi, Transfer
from stepped_board import shipped_board, stepped_board
from wire_kernel import Spidev

SILENT = pulse(0, *[PAUSE] * 8)

#: A port, and the clock that its time is spent on.
Driver = tuple[Spi, Clock]


@pytest.fixture(params=["here", "board process"])
def driver(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Driver]:
    if request.param == "here":
        opened = stepped_board().backend
        yield opened.spi, opened.clock
        return
    board = shipped_board("kajimoto-hv507")
    with running_board(board, tmp_path) as running:
        ports = open_remote(
            running.socket, SteppedClock(), board, line_setup(board), spi_setup(board)
        )
        yield ports.spi, ports.line.clock
        ports.close()


def took_ns(driver: Driver, send: Callable[[Message], object]) -> int:
    clock = driver[1]
    begun_ns = clock.now_ns()
    send(SILENT)
    return clock.now_ns() - begun_ns


def test_the_first_sending_takes_longer_by_the_laying_out(driver: Driver) -> None:
    first_ns, second_ns = (took_ns(driver, driver[0].transfer) for _ in range(2))
    assert first_ns - second_ns == PI4.laying_out_ns(10)


def test_a_message_that_is_prepared_takes_the_same_each_time(driver: Driver) -> None:
    spi = driver[0]
    assert took_ns(driver, spi.prepare) == PI4.laying_out_ns(10)
    assert took_ns(driver, spi.transfer) == took_ns(driver, spi.transfer)
    assert took_ns(driver, spi.prepare) == 0


@given(st.lists(st.tuples(st.integers(0, 4), st.booleans()), max_size=40))
def test_the_fake_lays_out_the_messages_that_the_driver_lays_out(
    sent: list[tuple[int, bool]],
) -> None:
    """In whatever order they come, and another one of the same transfers in between."""
    kernel = Spidev()
    spi = LinuxSpi(kernel, "/dev/spidev0.0", 10_400_000, kernel.ioctl)
    fake = object()
    counted = [CountedTransfers((Transfer(bytes(2)),)) for _ in range(5)]
    messages = [Message(transfers) for transfers in counted]
    for number, is_another in sent:
        if is_another:
            messages[number] = Message(counted[number])
        before = counted[number].readings
        spi.prepare(messages[number])
        is_laid_out = counted[number].readings > before
        took_ns = lay_out(messages[number], fake, "/dev/spidev0.0", PI4)
        assert is_laid_out == (took_ns > 0)
