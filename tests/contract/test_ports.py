"""What every backend keeps to: the contracts written in etd_hal.ports, as tests.

All messages are at DAC code 0 and the supply stays off, so that this may run on a real board.
"""

from __future__ import annotations

import pytest

from etd_hal.backend import Backend
from etd_hal.boardfile import BoardFile, HalfBridgeLines
from etd_hal.errors import BusError
from etd_hal.linesetup import line_setup
from etd_hal.ports import Message, Transfer

pytestmark = pytest.mark.slow

ZERO = b"\x00\x00"
PAUSE = Transfer(delay_us=10)


def data_and_clock(board: BoardFile) -> tuple[int, int]:
    return board.switch.lines.DATA, board.switch.lines.CLK


class TestSpi:
    def test_a_message_returns_one_entry_for_each_transfer_with_data(
        self, backend: Backend
    ) -> None:
        message = Message((Transfer(ZERO, cs_change=True), PAUSE, Transfer(ZERO)))
        reads = backend.spi.transfer(message)
        assert [len(read) for read in reads] == [2, 2]

    def test_the_adc_frame_has_its_zero_bits_where_they_belong(self, backend: Backend) -> None:
        (read,) = backend.spi.transfer(Message((Transfer(ZERO),)))
        assert int.from_bytes(read, "big") & 0xC003 == 0

    def test_32_transfers_with_data_go_through(self, backend: Backend) -> None:
        words = [Transfer(ZERO, cs_change=True)] * 31
        assert len(backend.spi.transfer(Message((*words, Transfer(ZERO))))) == 32

    def test_a_33rd_transfer_with_data_is_too_long(self, backend: Backend) -> None:
        words = [Transfer(ZERO, cs_change=True)] * 32
        with pytest.raises(BusError) as raised:
            backend.spi.transfer(Message((*words, Transfer(ZERO))))
        assert raised.value.kind == "too_long"

    def test_512_transfers_are_refused_because_they_would_do_nothing(
        self, backend: Backend
    ) -> None:
        with pytest.raises(BusError) as raised:
            backend.spi.transfer(Message((*[Transfer()] * 511, Transfer(ZERO))))
        assert raised.value.kind == "invalid"

    def test_511_transfers_go_through(self, backend: Backend) -> None:
        message = Message((*[Transfer()] * 510, Transfer(ZERO)))
        assert len(backend.spi.transfer(message)) == 1

    def test_a_message_lasts_at_least_as_long_as_its_delays(self, backend: Backend) -> None:
        message = Message((Transfer(ZERO, cs_change=True), *[PAUSE] * 20, Transfer(ZERO)))
        begun_ns = backend.clock.now_ns()
        backend.spi.transfer(message)
        assert backend.clock.now_ns() - begun_ns >= 200_000

    def test_what_is_prepared_goes_through_and_what_sending_refuses_is_refused(
        self, backend: Backend
    ) -> None:
        message = Message((Transfer(ZERO, cs_change=True), *[PAUSE] * 100, Transfer(ZERO)))
        backend.spi.prepare(message)
        backend.spi.prepare(message)
        assert [len(read) for read in backend.spi.transfer(message)] == [2, 2]
        words, delays = (Transfer(ZERO, cs_change=True),) * 32, (Transfer(),) * 511
        for refused, kind in ((words, "too_long"), (delays, "invalid")):
            with pytest.raises(BusError) as raised:
                backend.spi.prepare(Message((*refused, Transfer(ZERO))))
            assert raised.value.kind == kind

    def test_a_refused_message_leaves_the_bus_usable(self, backend: Backend) -> None:
        with pytest.raises(BusError):
            backend.spi.transfer(Message(tuple([Transfer()] * 600)))
        assert len(backend.spi.transfer(Message((Transfer(ZERO),)))) == 1


class TestGpio:
    def test_outputs_have_the_levels_they_were_requested_with(
        self, backend: Backend, board: BoardFile
    ) -> None:
        for line, value in line_setup(board).outputs:
            assert backend.gpio.get(line) == value

    def test_an_output_reads_back_as_it_was_set(self, backend: Backend, board: BoardFile) -> None:
        data, clock = data_and_clock(board)
        backend.gpio.set(((data, 1), (clock, 1)))
        assert (backend.gpio.get(data), backend.gpio.get(clock)) == (1, 1)
        backend.gpio.set(((clock, 0), (data, 0)))
        assert (backend.gpio.get(data), backend.gpio.get(clock)) == (0, 0)

    def test_a_line_that_was_not_requested_is_invalid(self, backend: Backend) -> None:
        with pytest.raises(BusError) as raised:
            backend.gpio.set(((2, 1),))
        assert raised.value.kind == "invalid"

    def test_an_input_cannot_be_set(self, backend: Backend, board: BoardFile) -> None:
        if not line_setup(board).inputs:
            pytest.skip("the board has no inputs")
        with pytest.raises(BusError) as raised:
            backend.gpio.set(((line_setup(board).inputs[0].line, 1),))
        assert raised.value.kind == "invalid"

    def test_one_bad_line_among_good_ones_changes_nothing(
        self, backend: Backend, board: BoardFile
    ) -> None:
        data, _ = data_and_clock(board)
        with pytest.raises(BusError):
            backend.gpio.set(((data, 1), (2, 1)))
        assert backend.gpio.get(data) == 0

    def test_without_a_change_there_are_no_edges(self, backend: Backend) -> None:
        backend.gpio.edges()
        assert backend.gpio.edges() == ()

    def test_the_chain_comes_out_at_readback_after_its_length(
        self, backend: Backend, board: BoardFile
    ) -> None:
        readback = board.guards.readback
        if readback == "absent" or not isinstance(board.switch.lines, HalfBridgeLines):
            pytest.skip("the board has no readback")
        data, clock = data_and_clock(board)
        for bit in (1, *[0] * (board.switch.outputs - 1)):
            backend.gpio.set(((data, bit), (clock, 1)))
            backend.gpio.set(((clock, 0),))
        assert backend.gpio.get(readback) == 1
        backend.gpio.set(((data, 0), (clock, 1)))
        assert backend.gpio.get(readback) == 0


class TestI2c:
    def test_an_address_that_nobody_owns_is_absent(self, backend: Backend) -> None:
        if backend.i2c is None:
            pytest.skip("the board has no I2C")
        with pytest.raises(BusError) as raised:
            backend.i2c.transfer(0x33, b"\x00", 1)
        assert raised.value.kind == "absent"

    def test_the_rail_monitor_answers_with_its_configuration(
        self, backend: Backend, board: BoardFile
    ) -> None:
        monitor = board.guards.rail_monitor
        if backend.i2c is None or monitor == "absent":
            pytest.skip("the board has no rail monitor")
        # The low four bits are 0: chips with 12-bit limits there can stand in for the monitor.
        backend.i2c.transfer(monitor.address, bytes((0x02, 0x12, 0x30)), 0)
        assert backend.i2c.transfer(monitor.address, b"\x02", 2) == bytes((0x12, 0x30))
        backend.i2c.transfer(monitor.address, bytes((0x02, 0x80, 0x00)), 0)


class TestClock:
    def test_a_sleep_ends_at_its_deadline_or_later(self, backend: Backend) -> None:
        deadline_ns = backend.clock.now_ns() + 2_000_000
        backend.clock.sleep_until_ns(deadline_ns)
        assert backend.clock.now_ns() >= deadline_ns

    def test_a_deadline_in_the_past_does_not_turn_time_back(self, backend: Backend) -> None:
        now_ns = backend.clock.now_ns()
        backend.clock.sleep_until_ns(now_ns - 1_000_000)
        assert backend.clock.now_ns() >= now_ns


class TestMarker:
    def test_a_mark_disturbs_nothing(self, backend: Backend) -> None:
        backend.marker.mark("frame", 7, None)
        backend.marker.mark("mark", 7, 3)
        backend.marker.mark("mark", 7, "begin block 2")
        assert len(backend.spi.transfer(Message((Transfer(ZERO),)))) == 1
