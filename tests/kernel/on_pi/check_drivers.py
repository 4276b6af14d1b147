"""The Pi's own drivers under ours: lines, words and chip select as the drivers made them.

Runs on the emulated Pi only. Nothing hangs on its header but a thermometer on the I2C bus, so
inputs read 0, and so does what comes back over SPI.
"""

from __future__ import annotations

import errno
import fcntl
from collections.abc import Iterator
from pathlib import Path

import pytest

import kernel_trace
import pi_board
import trace_decoder
from etd_hal.backend import Backend
from etd_hal.board import Board
from etd_hal.compose import open_linux
from etd_hal.errors import BusError, HardwareMissing
from etd_hal.linesetup import line_setup
from etd_hal.linux import machine
from etd_hal.linux.gpio import find_chip
from etd_hal.timing import Shape, pulse_message
from kernel_trace import Event
from pi_board import BOARD, BOARD_PATH, LINES, MACHINE, MACHINE_PATH, NAMES, line_calls

#: 1365/4095 of 10 mA; a word is two zero bits, twelve of the code, two that do not count.
CODE = 1_365
WORD = bytes((1_365 >> 6, (1_365 & 0x3F) << 2))
ZERO = bytes(2)
SPI_IOC_WR_BITS_PER_WORD = 0x40016B03


@pytest.fixture(scope="session", autouse=True)
def probes() -> None:
    pi_board.set_probes()


@pytest.fixture
def ports() -> Iterator[Backend]:
    """The shipped drivers on the Pi's; the trace begins before they are opened."""
    kernel_trace.begin()
    opened = open_linux(BOARD, MACHINE)
    yield opened
    opened.close()


@pytest.fixture
def board(ports: Backend) -> Board:
    board = Board(BOARD, MACHINE, ports.codec, ports.spi, ports.gpio, ports.clock)
    assert board.safe_off() == ()
    return board


def only_message() -> list[Event]:
    (message,) = kernel_trace.messages(kernel_trace.events())
    return message


def test_each_bus_has_the_pis_own_driver() -> None:
    bound = Path("/sys/bus/platform/drivers")
    drivers = pi_board.DRIVERS
    found = [name for name, device in drivers.items() if (bound / name / device).exists()]
    print("", *machine.facts()[:2], *found, sep="\n  ")
    assert found == list(drivers)


def test_the_machine_is_the_pi_3_of_the_shipped_machine_file() -> None:
    assert machine.problem(MACHINE) is None
    assert machine.model() == "Raspberry Pi 3 Model B"


class TestLines:
    def test_the_chip_is_found_by_its_label_beside_the_firmwares(self) -> None:
        with pytest.raises(BusError, match="raspberrypi-exp-gpio"):
            find_chip(("no such label",))
        assert find_chip(BOARD.gpio_chip_labels).name == "gpiochip0"

    def test_lines_become_outputs_in_the_order_of_the_request_at_their_levels(
        self, ports: Backend
    ) -> None:
        wanted = [(NAMES[line], level) for line, level in line_setup(BOARD).outputs]
        # Twice, since they are let go of once, to see that this kernel makes inputs of them.
        assert line_calls(kernel_trace.events(), "rig_output") == 2 * wanted
        assert wanted[:3] == [("POL", 1), ("BL", 0), ("HV", 0)]

    def test_lines_of_one_call_change_in_ascending_order_whatever_order_is_given(
        self, ports: Backend
    ) -> None:
        kernel_trace.begin()
        ports.gpio.set(((LINES["CLK"], 1), (LINES["LE"], 0), (LINES["DATA"], 1)))
        assert line_calls(kernel_trace.events()) == [("DATA", 1), ("LE", 0), ("CLK", 1)]
        assert [ports.gpio.get(LINES[name]) for name in ("DATA", "LE", "CLK")] == [1, 0, 1]
        ports.gpio.set(((LINES["CLK"], 0), (LINES["DATA"], 0)))
        assert [ports.gpio.get(LINES[name]) for name in ("DATA", "LE", "CLK")] == [0, 0, 0]

    @pytest.mark.parametrize("output", [0, 63])
    def test_a_selection_puts_one_output_on_the_source_and_all_others_on_ground(
        self, board: Board, output: int
    ) -> None:
        selection = board.selection(output, None)
        board.prepare(selection, whole=True)
        board.connect(selection, True)
        wires = trace_decoder.Wires(trace_decoder.Facts.of(pi_board.trace_header()))
        for t_ns, line, level in pi_board.line_records(kernel_trace.events()):
            wires.change(t_ns, line, level)
        everybody = frozenset(range(64))
        assert wires.sides() == (frozenset({output}), everybody - {output})
        assert board.safe_off() == ()

    def test_lines_that_are_held_are_busy_for_a_second_daemon(self, ports: Backend) -> None:
        kernel_trace.begin()
        with pytest.raises(HardwareMissing) as raised:
            open_linux(BOARD, MACHINE)
        (problem,) = raised.value.problems
        assert "busy" in problem
        assert "POL (4) is held by 'etd'" in problem
        moved = [name for name, _ in line_calls(kernel_trace.events()) if name != "CE0"]
        assert moved == [], "a refused request moved a line"

    def test_a_stop_line_that_nothing_holds_up_says_stop(self, ports: Backend) -> None:
        stops = [line.line for line in line_setup(BOARD).inputs]
        assert stops == [BOARD.guards.emergency_stop, BOARD.guards.wearer_stop]
        assert [ports.gpio.get(line) for line in stops] == [0, 0]
        assert ports.gpio.edges() == ()


class TestSpi:
    def test_the_bus_takes_the_boards_mode_and_speed_and_words_of_8_bits(
        self, ports: Backend
    ) -> None:
        setups = [event.rest for event in kernel_trace.events() if event.name == "spi_setup"]
        assert setups[-1].startswith("spi0.0 setup mode 1, cs_high, 8 bits/w, 20800000 Hz max")
        assert setups[-1].endswith("--> 0")

    def test_words_of_16_bits_are_not_for_this_driver(self) -> None:
        with (
            open(BOARD.source.spi, "rb+", buffering=0) as device,
            pytest.raises(OSError) as raised,
        ):
            fcntl.ioctl(device, SPI_IOC_WR_BITS_PER_WORD, bytes((16,)))
        assert raised.value.errno == errno.EINVAL

    def test_chip_select_is_high_at_rest_and_low_around_each_word(self, ports: Backend) -> None:
        opened = line_calls(kernel_trace.events())
        assert {call for call in opened if call[0] == "CE0"} == {("CE0", 1)}
        kernel_trace.begin()
        ports.spi.transfer(pulse_message(ports.codec, CODE, Shape((10, 10), True, 0.0, 0.0)))
        assert line_calls(kernel_trace.events()) == [("CE0", 0), ("CE0", 1)] * 3

    def test_a_pulse_is_its_word_the_pauses_and_zero(self, ports: Backend) -> None:
        kernel_trace.begin()
        ports.spi.transfer(pulse_message(ports.codec, CODE, Shape((10, 10, 7), False, 0.0, 0.0)))
        message = only_message()
        starts = [event for event in message if event.name == "spi_transfer_start"]
        stops = [event.t_us for event in message if event.name == "spi_transfer_stop"]
        assert [event.tx for event in starts] == [WORD, b"", b"", b"", ZERO]
        pauses = zip(stops, (event.t_us for event in starts[1:]), (10, 10, 10, 7), strict=False)
        # The pause after the word is that of chip select; stamps are cut to whole microseconds.
        assert all(begin - stop >= least - 1 for stop, begin, least in pauses)

    def test_words_are_polled_for_and_never_wait_for_an_interrupt(self, ports: Backend) -> None:
        before = pi_board.transfer_counts()
        ports.spi.transfer(pulse_message(ports.codec, CODE, Shape((10, 10), True, 0.0, 0.0)))
        after = pi_board.transfer_counts()
        assert {how: after[how] - before[how] for how in after} == {
            "polling": 3,
            "irq": 0,
            "irq_after_polling": 0,
            "dma": 0,
        }


class TestI2c:
    def test_nobody_at_an_address_is_the_kernels_remote_error(self, ports: Backend) -> None:
        assert ports.i2c is not None
        with pytest.raises(BusError) as raised:
            ports.i2c.transfer(0x33, b"\x00", 1)
        assert raised.value.kind == "absent"
        cause = raised.value.__cause__
        assert isinstance(cause, OSError)
        assert cause.errno == errno.EREMOTEIO

    def test_what_is_written_to_the_thermometer_comes_back(self, ports: Backend) -> None:
        assert ports.i2c is not None
        ports.i2c.transfer(0x48, bytes((0x03, 0x2A, 0x50)), 0)
        assert ports.i2c.transfer(0x48, b"\x03", 2) == bytes((0x2A, 0x50))
        # Without a register it is the last one.
        assert ports.i2c.transfer(0x48, b"", 2) == bytes((0x2A, 0x50))

    def test_a_write_and_a_read_are_one_transaction(self, ports: Backend) -> None:
        pi_board.watch_i2c()
        kernel_trace.begin()
        assert ports.i2c is not None
        ports.i2c.transfer(0x48, b"\x03", 2)
        results = [event.rest for event in kernel_trace.events() if event.name == "i2c_result"]
        assert results == ["i2c-1 n=2 ret=2"]


def test_safe_drives_the_lines_first_and_then_sends_zero() -> None:
    kernel_trace.begin()
    pi_board.etd("safe", "--board", str(BOARD_PATH), "--machine", str(MACHINE_PATH))
    events = kernel_trace.events()
    assert line_calls(events, "rig_output")[:3] == [("POL", 1), ("BL", 0), ("HV", 0)]
    sent = [event for event in events if event.name == "spi_transfer_start"]
    assert {event.tx for event in sent} == {ZERO}
    first_output = next(event for event in events if event.name == "rig_output")
    assert first_output.t_us <= sent[0].t_us
