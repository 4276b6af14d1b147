"""Buses that fail: absent, stuck, erring, unplugged, as the kernel reports them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import kernel_trace
from etd_hal.backend import Backend
from etd_hal.board import Board
from etd_hal.chips.ad5452 import word
from etd_hal.errors import BusError
from etd_hal.fake import wire
from etd_hal.ports import Edge, Message, Transfer
from guest_board import BOARD, MACHINE, Chips, set_parameter, unplugged

MONITOR = 0x48
EIO, EREMOTEIO = 5, 121


@pytest.fixture(autouse=True)
def no_fault_stays() -> Iterator[None]:
    yield
    for name, value in (("i2c_errno", 0), ("i2c_stuck_ms", 0), ("spi_fail_at", -1)):
        set_parameter(name, value)


def read_monitor(ports: Backend) -> bytes:
    assert ports.i2c is not None
    return ports.i2c.transfer(MONITOR, b"\x01", 2)


class TestI2c:
    def test_an_address_without_a_chip_is_absent(self, ports: Backend) -> None:
        assert ports.i2c is not None
        with pytest.raises(BusError) as raised:
            ports.i2c.transfer(0x21, b"\x00", 1)
        assert raised.value.kind == "absent"

    def test_a_chip_that_stops_answering_is_absent(self, ports: Backend) -> None:
        set_parameter("i2c_errno", EREMOTEIO)
        with pytest.raises(BusError) as raised:
            read_monitor(ports)
        assert raised.value.kind == "absent"

    def test_a_stuck_bus_is_a_time_out_after_the_kernels_second(self, ports: Backend) -> None:
        set_parameter("i2c_stuck_ms", 1_000)
        begun_ns = ports.clock.now_ns()
        with pytest.raises(BusError) as raised:
            read_monitor(ports)
        assert raised.value.kind == "timeout"
        assert ports.clock.now_ns() - begun_ns >= 1_000_000_000

    def test_a_transaction_that_is_cut_is_an_io_error_and_the_next_one_works(
        self, ports: Backend
    ) -> None:
        set_parameter("i2c_errno", EIO)
        with pytest.raises(BusError) as raised:
            read_monitor(ports)
        assert raised.value.kind == "io"
        set_parameter("i2c_errno", 0)
        assert len(read_monitor(ports)) == 2


class TestSpi:
    def test_a_transfer_that_fails_ends_the_message_before_its_zero(self, ports: Backend) -> None:
        """Why the first thing after an error is GPIO: the kernel does not send the rest."""
        pulse = Message((Transfer(word(100), cs_change=True), Transfer(word(0))))
        kernel_trace.begin()
        set_parameter("spi_fail_at", 1)
        with pytest.raises(BusError) as raised:
            ports.spi.transfer(pulse)
        assert raised.value.kind == "io"
        (message,) = kernel_trace.messages(kernel_trace.events())
        stops = [event for event in message if event.name == "spi_set_cs" and not event.is_active]
        assert len(stops) == 2, "chip select was left active"
        ports.spi.transfer(Message((Transfer(word(0)),)))


class TestStops:
    def test_a_pressed_stop_is_an_edge_with_its_time_and_a_level(
        self, ports: Backend, chips: Chips
    ) -> None:
        line = BOARD.guards.emergency_stop
        assert line != "absent"
        assert ports.gpio.get(line) == 1
        begun_ns = ports.clock.now_ns()
        chips.knock(wire.Press("emergency_stop", 0))
        edges = wait_for_edges(ports)
        assert [(edge.line, edge.value) for edge in edges] == [(line, 0)]
        assert begun_ns <= edges[0].t_ns <= ports.clock.now_ns()
        assert ports.gpio.get(line) == 0
        chips.knock(wire.Press("emergency_stop", 1))
        assert [edge.value for edge in wait_for_edges(ports)] == [1]


class TestTrigger:
    def test_an_edge_on_it_comes_with_its_time(self, ports: Backend, chips: Chips) -> None:
        trigger = BOARD.trigger
        assert trigger != "absent"
        assert ports.gpio.get(trigger.line) == 0
        begun_ns = ports.clock.now_ns()
        chips.knock(wire.GiveEdge(lasts_ns=200_000_000))
        edges = wait_for_edges(ports)
        assert [(edge.line, edge.value) for edge in edges] == [(trigger.line, 1)]
        assert begun_ns <= edges[0].t_ns <= ports.clock.now_ns()
        assert [edge.value for edge in wait_for_edges(ports)] == [0]


def wait_for_edges(ports: Backend) -> tuple[Edge, ...]:
    deadline_ns = ports.clock.now_ns() + 5_000_000_000
    while ports.clock.now_ns() < deadline_ns:
        edges = ports.gpio.edges()
        if edges:
            return edges
        ports.clock.sleep_until_ns(ports.clock.now_ns() + 1_000_000)
    pytest.fail("no edge came")


class TestUnplugged:
    def test_spi_that_is_unplugged_is_told_and_the_lines_still_work(self, ports: Backend) -> None:
        board = Board(BOARD, MACHINE, ports.codec, ports.spi, ports.gpio, ports.clock)
        with unplugged("rig-spi"):
            with pytest.raises(BusError) as raised:
                ports.spi.transfer(Message((Transfer(word(0)),)))
            problems = board.safe_off()
        assert raised.value.kind == "gone"
        assert problems
        assert all("spidev0.0" in problem for problem in problems)
        calls = [event.rest for event in kernel_trace.events() if event.name == "rig_line"]
        assert calls

    def test_lines_that_are_unplugged_are_told(self, ports: Backend) -> None:
        data = BOARD.switch.lines.DATA
        with unplugged("rig-gpio"):
            with pytest.raises(BusError) as raised:
                ports.gpio.set(((data, 1),))
            assert raised.value.kind == "gone"
