"""The shape of a pulse, and the calibration of the machine that plays it."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from board_rig import BoardRig, changed, machine_file
from etd_hal.boardfile import Bounds, MachineFile
from etd_hal.compose import codec_of
from etd_hal.errors import BoardFault
from etd_hal.fake.faults import SpiError, SpiJitter, SpiStall
from etd_hal.fake.machines import PI4
from etd_hal.ports import Message, Transfer
from etd_hal.timing import Shape, Timing, calibrate, pulse_message, zero_message
from stepped_board import shipped_board

pytestmark = pytest.mark.slow

Boards = Callable[..., BoardRig]

#: On the fake: chip select falls, three microseconds, 18 clocks, rises, and the gap of 10 us.
FAKE_WORD_US = 0.4 + 3.0 + 18 / 20.8 + 0.7 + 10.0
FAKE = Timing(word_us=FAKE_WORD_US, delay_extra_us=0.3, message_us=13.831, spread_us=0.0)

CODEC = codec_of(shipped_board("kajimoto-hv507").source)

timings = st.builds(
    Timing,
    word_us=st.floats(8.0, 20.0),
    delay_extra_us=st.floats(0.0, 6.0),
    message_us=st.floats(1.0, 2_000.0),
    spread_us=st.just(0.0),
)


class TestShape:
    @given(timings, st.integers(20, 200))
    def test_a_pulse_is_never_wider_than_asked(self, timing: Timing, width_us: int) -> None:
        assert timing.shape(width_us).width_us <= width_us + 1e-9

    @given(timings, st.integers(20, 200))
    def test_a_pulse_is_narrower_by_less_than_a_microsecond(
        self, timing: Timing, width_us: int
    ) -> None:
        assume(width_us >= timing.word_us + timing.delay_extra_us)
        # A sum of floats at a whole microsecond may be off by its last bit.
        assert timing.shape(width_us).width_us > width_us - 1 - 1e-9

    @given(st.floats(8.0, 20.0), st.floats(0.25, 0.75), st.integers(50, 200))
    def test_it_is_closer_where_one_delay_more_has_the_overhead_that_is_left(
        self, word_us: float, delay_extra_us: float, width_us: int
    ) -> None:
        timing = Timing(word_us, delay_extra_us, message_us=10.0, spread_us=0.0)
        assert timing.shape(width_us).width_us > width_us - 0.75 - 1e-6

    @given(timings, st.integers(20, 200))
    def test_all_delays_are_alike_and_none_is_zero_where_there_is_time_for_each(
        self, timing: Timing, width_us: int
    ) -> None:
        delays_us = timing.shape(width_us).delays_us
        assume(sum(delays_us) >= len(delays_us) > 0)
        assert max(delays_us) - min(delays_us) <= 1
        assert min(delays_us) > 0

    @given(timings, st.integers(20, 200))
    def test_width_and_duration_are_what_the_parts_sum_up_to(
        self, timing: Timing, width_us: int
    ) -> None:
        shape = timing.shape(width_us)
        words = 2 if shape.has_end_sample else 1
        held_us = words * timing.word_us + sum(
            delay + timing.delay_extra_us for delay in shape.delays_us
        )
        assert shape.width_us == pytest.approx(held_us)
        assert shape.duration_us == pytest.approx(held_us + timing.message_us)

    @given(timings, st.integers(20, 200))
    def test_no_delay_is_longer_than_the_kernel_busy_waits(
        self, timing: Timing, width_us: int
    ) -> None:
        assert all(0 <= delay <= 10 for delay in timing.shape(width_us).delays_us)

    @pytest.mark.parametrize(
        ("width_us", "delays_us", "has_end_sample"),
        [
            (15, (), False),
            (20, (2, 2), False),
            (30, (5, 5, 4), False),
            (33, (1, 1), True),
            (50, (7, 6, 6), True),
            (100, (9,) * 3 + (8,) * 5, True),
            (200, (10,) * 2 + (9,) * 16, True),
        ],
    )
    def test_on_the_modelled_machine_a_width_is_so_many_delays(
        self, width_us: int, delays_us: tuple[int, ...], has_end_sample: bool
    ) -> None:
        shape = FAKE.shape(width_us)
        assert (shape.delays_us, shape.has_end_sample) == (delays_us, has_end_sample)

    def test_where_a_delay_costs_more_than_is_left_the_delays_before_it_give_way(self) -> None:
        timing = Timing(word_us=20.0, delay_extra_us=2.5, message_us=10.0, spread_us=0.0)
        assert timing.shape(54).delays_us == (5, 4)
        assert timing.shape(54).width_us == 54.0

    def test_there_is_no_end_sample_where_the_rest_could_not_be_filled(self) -> None:
        timing = Timing(word_us=10.0, delay_extra_us=6.0, message_us=10.0, spread_us=0.0)
        assert timing.shape(25).width_us == 25.0
        assert not timing.shape(25).has_end_sample
        assert timing.shape(26).has_end_sample

    def test_a_width_below_one_word_is_refused_with_the_shortest_there_is(self) -> None:
        with pytest.raises(BoardFault, match="shortest pulse") as caught:
            FAKE.shape(14)
        assert caught.value.measured == "15.0 us for one word"


class TestMessage:
    def test_a_pulse_is_the_code_then_pure_delays_then_zero(self) -> None:
        shape = Shape((10, 3), has_end_sample=False, width_us=30.0, duration_us=44.0)
        assert pulse_message(CODEC, 1228, shape).transfers == (
            Transfer(bytes.fromhex("1330"), 0, True),
            Transfer(b"", 10, False),
            Transfer(b"", 3, False),
            Transfer(b"\x00\x00", 0, False),
        )

    def test_an_end_sample_is_the_same_word_again_just_before_the_end(self) -> None:
        shape = Shape((10,), has_end_sample=True, width_us=42.0, duration_us=56.0)
        assert [transfer.tx.hex() for transfer in pulse_message(CODEC, 1228, shape).transfers] == [
            "1330", "", "1330", "0000",
        ]  # fmt: skip
        assert [transfer.cs_change for transfer in pulse_message(CODEC, 1228, shape).transfers] == [
            True, False, True, False,
        ]  # fmt: skip

    def test_zero_is_one_word(self) -> None:
        assert zero_message(CODEC).transfers == (Transfer(b"\x00\x00"),)

    @pytest.mark.parametrize("width_us", [20, 33, 50, 77, 100, 150, 200])
    @pytest.mark.parametrize("code", [1, 409, 4095])
    def test_on_the_wire_the_current_flows_for_the_width(
        self, boards: Boards, width_us: int, code: int
    ) -> None:
        rig = boards()
        current_ua = -(-code * 10_000 // 4095)
        rig.visit(3, current_ua=current_ua, width_us=width_us)
        body = rig.body()[-1]
        assert width_us - 1 < (body["to_ns"] - body["from_ns"]) / 1_000 <= width_us
        assert body["asked_ua"] == round(code * 10_000 / 4095)


def duration_by(timing: Timing) -> Callable[[Message], int]:
    """A machine that keeps the model exactly."""

    def duration_ns(message: Message) -> int:
        words = sum(1 for transfer in message.transfers if transfer.tx)
        delays_us = [transfer.delay_us for transfer in message.transfers if not transfer.tx]
        held_us = sum(delay + timing.delay_extra_us for delay in delays_us)
        return round(1_000 * (timing.message_us + (words - 1) * timing.word_us + held_us))

    return duration_ns


class TestCalibration:
    def test_on_the_fake_it_finds_the_cost_model(self, boards: Boards) -> None:
        timing = boards(begun=False).board.calibrate()
        assert timing.word_us == pytest.approx(FAKE_WORD_US, abs=0.002)
        assert timing.delay_extra_us == pytest.approx(PI4.empty_transfer_ns / 1_000, abs=0.002)
        around_us = (PI4.message_before_ns + PI4.message_after_ns) / 1_000
        assert timing.message_us == pytest.approx(around_us + FAKE_WORD_US - 10.0, abs=0.002)
        assert timing.spread_us == 0.0

    def test_it_never_sends_anything_but_code_zero(self, boards: Boards) -> None:
        rig = boards(begun=False)
        rig.board.calibrate()
        sent = {entry["tx"] for entry in rig.records() if entry.get("event") == "transfer"}
        assert sent == {"", "0000"}
        assert rig.body() == []

    def test_its_messages_have_up_to_forty_delays_and_eight_words(self, boards: Boards) -> None:
        rig = boards(begun=False)
        rig.board.calibrate()
        counts = {entry["transfers"] for entry in rig.records() if entry.get("event") == "message"}
        assert (min(counts), max(counts)) == (2, 42)
        assert set(range(2, 9)) <= counts

    @given(
        st.builds(
            Timing,
            word_us=st.floats(12.0, 22.0),
            delay_extra_us=st.floats(0.06, 1.19),
            message_us=st.floats(3.0, 40.0),
            spread_us=st.just(0.0),
        )
    )
    def test_it_finds_any_machine_that_keeps_the_model(self, true: Timing) -> None:
        (found,) = calibrate(duration_by(true), machine_file(), CODEC)
        assert found.word_us == pytest.approx(true.word_us, abs=0.01)
        assert found.delay_extra_us == pytest.approx(true.delay_extra_us, abs=0.01)
        assert found.message_us == pytest.approx(true.message_us, abs=0.02)

    @pytest.mark.parametrize(
        ("wrong", "what"),
        [
            ({"word_us": 11.8}, "one word"),
            ({"word_us": 24.2}, "one word"),
            ({"delay_extra_us": 0.02}, "overhead of a delay"),
            ({"delay_extra_us": 1.3}, "overhead of a delay"),
            ({"message_us": 2.8}, "overhead of a message"),
            ({"message_us": 40.2}, "overhead of a message"),
        ],
    )
    def test_an_implausible_constant_is_refused_by_name(
        self, wrong: dict[str, float], what: str
    ) -> None:
        constants = {"word_us": 16.0, "delay_extra_us": 0.3, "message_us": 14.0, "spread_us": 0.0}
        machine = duration_by(Timing(**(constants | wrong)))
        with pytest.raises(BoardFault) as caught:
            calibrate(machine, machine_file(), CODEC)
        assert caught.value.what == f"timing calibration, {what}"
        bounds = {"one word": "12.0 to 24.0 us", "overhead of a delay": "0.05 to 1.2 us"}
        assert caught.value.expected == bounds.get(what, "3.0 to 40.0 us")

    @pytest.mark.parametrize("edge", [{"word_us": 12.0}, {"word_us": 24.0}, {"message_us": 40.0}])
    def test_a_constant_on_its_bound_is_plausible(self, edge: dict[str, float]) -> None:
        constants = {"word_us": 16.0, "delay_extra_us": 0.3, "message_us": 14.0, "spread_us": 0.0}
        calibrate(duration_by(Timing(**(constants | edge))), machine_file(), CODEC)

    def test_stalls_in_every_round_are_refused_as_spread(self, boards: Boards) -> None:
        rig = boards(begun=False, faults=[SpiJitter(every=5, late_us=50)])
        with pytest.raises(BoardFault) as caught:
            rig.board.calibrate()
        assert caught.value.what == "timing calibration, spread of a message"

    @pytest.mark.parametrize("every", [2, 3, 4, 8, 16])
    def test_nor_are_they_taken_for_a_speed_when_they_come_at_the_same_messages(
        self, boards: Boards, every: int
    ) -> None:
        """A round has sixteen messages: the rounds are alike."""
        rig = boards(begun=False, faults=[SpiJitter(every=every, late_us=20)])
        with pytest.raises(BoardFault, match="spread of a message"):
            rig.board.calibrate()

    @pytest.mark.parametrize("disturbed", [1, 40, 100])
    def test_a_round_that_was_disturbed_does_not_spoil_the_calibration(
        self, boards: Boards, disturbed: int
    ) -> None:
        stalls = [SpiStall(stall_us=500, at_message=disturbed + each) for each in range(20)]
        rig = boards(begun=False, faults=stalls)
        assert rig.board.calibrate().word_us == pytest.approx(FAKE_WORD_US, abs=0.002)

    def test_a_slow_clock_on_the_wire_shows_as_slow_words(self, boards: Boards) -> None:
        slow = changed(shipped_board("kajimoto-hv507"), "source", speed_hz=4_000_000)
        strict: MachineFile = msgspec.structs.replace(
            machine_file(), word_us=Bounds(low=12.0, high=18.0)
        )
        rig = boards(begun=False, board=slow, machine=strict)
        with pytest.raises(BoardFault, match=r"one word: measured 18\.60 us"):
            rig.board.calibrate()

    def test_a_failed_calibration_leaves_no_timing_behind(self, boards: Boards) -> None:
        rig = boards(begun=False, faults=[SpiError(at_message=5)])
        with pytest.raises(Exception, match="transfer"):
            rig.board.calibrate()
        with pytest.raises(BoardFault, match="not calibrated"):
            rig.board.pulse(1_000, 100)
