"""What the kernel refuses, and how it is told: lines held, no real time, what it misreads."""

from __future__ import annotations

import ctypes
import fcntl
import gc
import mmap
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

import kernel_trace
from etd.selftest.realtime import missing
from etd_hal.backend import Backend
from etd_hal.errors import BusError, HardwareMissing
from etd_hal.linesetup import line_setup
from etd_hal.linux import uapi
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.gpio import LinuxGpio, find_chip, holders, open_gpio
from etd_hal.linux.machine import facts
from etd_hal.linux.opening import open_to_make_safe
from etd_hal.linux.realtime import obtained, set_up
from etd_hal.linux.scan_core import scan_core
from etd_hal.linux.side_process import SideProcess
from etd_hal.ports import LineSetup, Message, Transfer
from guest_board import BOARD, Chips, unplugged, without_rights

LINES = BOARD.used_lines()
OUTPUT, INPUT = LINES["DATA"], LINES["READBACK"]
UNLOCKED_BYTES = 8 << 20
#: Of <linux/spi/spidev.h>; 14 bits of it are the size of what is passed.
SPI_IOC_MESSAGE_0 = 0x40006B00
#: The driver's buffers of changes (its `_KEPT`).
KEPT = 1_024
#: Zero words at code 0: nothing is fired here.
ZERO = Transfer(bytes(2))
CLOCK = LinuxClock()


@contextmanager
def held_by_somebody(line: int) -> Iterator[LinuxGpio]:
    """Another program has one line, at the level that is harmless."""
    setup = LineSetup(outputs=((line, 0),), inputs=(), consumer="somebody")
    taken = open_gpio(find_chip(BOARD.gpio_chip_labels), setup)
    yield taken
    taken.close()


@pytest.fixture
def quiet_interpreter() -> Iterator[None]:
    """What real time asks of Python is undone again."""
    interval_s = sys.getswitchinterval()
    yield
    gc.unfreeze()
    gc.enable()
    sys.setswitchinterval(interval_s)


def test_a_process_beside_the_scan_that_says_nothing_is_given_up() -> None:
    begun_ns = CLOCK.now_ns()
    with pytest.raises(BusError, match="does not come up"):
        _ = SideProcess("the mute", "mute", ()).refusals
    assert 20.0 <= (CLOCK.now_ns() - begun_ns) / 1e9 < 23.0


class TestLines:
    @pytest.mark.parametrize(("line", "asked"), [(OUTPUT, "outputs"), (INPUT, "inputs")])
    def test_a_line_that_is_taken_at_the_last_moment_is_busy_and_no_other_is_kept(
        self, chips: Chips, line: int, asked: str
    ) -> None:
        chip = find_chip(BOARD.gpio_chip_labels)
        with held_by_somebody(line):
            with pytest.raises(BusError, match=asked) as raised:
                open_gpio(chip, line_setup(BOARD))
            assert raised.value.kind == "busy"
            assert holders(chip, tuple(LINES.values())) == {line: "somebody"}

    def test_the_safe_state_is_reached_without_the_inputs(self, chips: Chips) -> None:
        with held_by_somebody(INPUT):
            gpio, spi, told = open_to_make_safe(BOARD, line_setup(BOARD))
        assert any("somebody" in sentence for sentence in told)
        assert gpio.edges() == ()
        gpio.close()
        assert spi is not None
        spi.close()

    def test_without_the_outputs_there_is_no_safe_state_and_the_holder_is_named(
        self, chips: Chips
    ) -> None:
        with held_by_somebody(OUTPUT), pytest.raises(HardwareMissing, match="somebody"):
            open_to_make_safe(BOARD, line_setup(BOARD))

    def test_lines_that_were_not_requested_are_neither_read_nor_set(self, ports: Backend) -> None:
        with pytest.raises(BusError) as raised:
            ports.gpio.get(0)
        assert raised.value.kind == "invalid"
        with pytest.raises(BusError) as raised:
            ports.gpio.set(((INPUT, 1),))
        assert raised.value.kind == "invalid"

    def test_buffers_are_kept_for_so_many_changes_and_no_more(self, ports: Backend) -> None:
        for count in range(KEPT + 6):
            # Few calls of the chip, and others each time.
            ports.gpio.set(tuple((OUTPUT, count >> bit & 1) for bit in range(11)))

    def test_lines_that_are_unplugged_are_not_read_either(self, ports: Backend) -> None:
        with unplugged("rig-gpio"):
            for ask in (lambda: ports.gpio.get(INPUT), ports.gpio.edges):
                with pytest.raises(BusError) as raised:
                    ask()
                assert raised.value.kind == "gone"

    def test_a_chip_with_another_label_is_absent_and_what_is_there_is_named(self) -> None:
        with pytest.raises(BusError, match=BOARD.gpio_chip_labels[0]) as raised:
            find_chip(("no such chip",))
        assert raised.value.kind == "absent"


class TestRealTime:
    def test_what_is_not_granted_of_real_time_is_told(self, quiet_interpreter: None) -> None:
        with without_rights():
            told = set_up(80, None)
        assert any("SCHED_FIFO 80" in sentence for sentence in told)

    def test_all_memory_is_locked_and_what_is_unlocked_again_is_missed(
        self, quiet_interpreter: None
    ) -> None:
        library = ctypes.CDLL(None)
        with mmap.mmap(-1, UNLOCKED_BYTES) as large:
            try:
                assert set_up(1, None) == ()
                locked = obtained()
                whole = (ctypes.c_char * UNLOCKED_BYTES).from_buffer(large)
                assert library.munlock(whole, ctypes.c_size_t(UNLOCKED_BYTES)) == 0
                partly = obtained()
                del whole
            finally:
                library.munlockall()
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        assert missing(locked, 1, None) == []
        (told,) = missing(partly, 1, None)
        assert f"of {partly.mapped_kb} kB" in told


class TestMessages:
    @pytest.mark.parametrize(
        "message",
        [
            Message(()),
            Message((ZERO, replace(ZERO, cs_change=True))),
            Message((replace(ZERO, delay_us=70_000), ZERO)),
        ],
        ids=["nothing", "chip select kept", "too long a delay"],
    )
    def test_what_the_kernel_would_misread_is_not_sent(
        self, ports: Backend, message: Message
    ) -> None:
        with pytest.raises(BusError) as raised:
            ports.spi.transfer(message)
        assert raised.value.kind == "invalid"

    def test_a_message_of_512_transfers_is_taken_by_the_kernel_and_not_sent(
        self, ports: Backend
    ) -> None:
        """Its size no longer fits into the request's number, which then asks for nothing."""
        number = SPI_IOC_MESSAGE_0 | (512 * uapi.TRANSFER_BYTES & 0x3FFF) << 16
        with Path(BOARD.source.spi).open("rb+", buffering=0) as device:
            assert fcntl.ioctl(device, number, bytearray(512 * uapi.TRANSFER_BYTES)) == 0
        assert list(kernel_trace.messages(kernel_trace.events())) == []
        with pytest.raises(ValueError, match="not 512"):
            uapi.spi_ioc_message(512)

    def test_an_i2c_transaction_of_nothing_is_refused(self, ports: Backend) -> None:
        assert ports.i2c is not None
        with pytest.raises(BusError) as raised:
            ports.i2c.transfer(0x48, b"", 0)
        assert raised.value.kind == "invalid"


def test_what_the_kernel_does_to_threads_that_never_sleep_is_told() -> None:
    throttle = Path("/proc/sys/kernel/sched_rt_runtime_us")
    usual = throttle.read_text()
    try:
        throttle.write_text("-1")
        assert "real-time throttling: off" in facts()
    finally:
        throttle.write_text(usual)
    assert any("us of every" in sentence for sentence in facts())


def test_a_thread_that_is_not_there_has_no_core_of_its_own() -> None:
    found = scan_core(thread=int(Path("/proc/sys/kernel/pid_max").read_text()))
    assert (found.core, found.is_isolated, found.is_left_alone) == (None, None, False)
