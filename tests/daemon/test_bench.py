"""What `etd bench` measures, and the machine file that it makes of it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_rig import board_rig
from etd.bench.computing import Computing
from etd.bench.loop import LoopFigures
from etd.bench.machine_file import measured_machine, toml_of
from etd.bench.messages import Messages, measure_messages
from etd.bench.result import Result, lines_of
from etd.bench.stages import STAGES, Stage, StageMeter, stages_of
from etd.bench.subject import KINDS
from etd.bench.wakeups import Wakeups, measure_wakeups
from etd.files.configuration import fake_config
from etd.protocol.errors import FileError
from etd_hal.boardfile import Bounds, load_machine
from etd_hal.compose import codec_of
from etd_hal.unwired import MovedClock

LOADED = fake_config("kajimoto-hv507")
PI4, CODEC = LOADED.machine, codec_of(LOADED.board.source)
US = 1_000


def each_reading_takes(step_ns: int) -> Iterator[int]:
    return count(0, step_ns)


class TestStages:
    def test_each_stage_is_what_lies_between_two_calls_less_the_reading_of_the_clock(self) -> None:
        now_ns = 0

        def processor_ns() -> int:
            return now_ns

        meter = StageMeter(processor_ns)
        for took_us, mark in enumerate(("look", "rest", "set", "message", "ended", "set"), start=1):
            now_ns += took_us * US
            if mark == "look":
                meter.look()
            else:
                meter.mark(mark, 1)  # type: ignore[arg-type]
        now_ns += 7 * US
        # Lines that are set while the next selection is shifted in belong to the same stage.
        meter.mark("set", 1)
        now_ns += US
        meter.look()
        assert meter.pulses[-1] == [2 * US, 3 * US, 4 * US, 6 * US, 8 * US]

    def test_a_probe_and_a_message_at_code_0_are_part_of_their_pulse(self) -> None:
        now_ns = 0
        meter = StageMeter(lambda: now_ns)
        meter.look()
        for mark, value in (("rest", 0), ("set", 1), ("message", 9), ("ended", 9)):
            now_ns += US
            meter.mark(mark, value)  # type: ignore[arg-type]
        now_ns += 5 * US
        meter.mark("message", 40)
        for mark, value in (("ended", 40), ("message", 0), ("ended", 0), ("set", 1)):
            now_ns += US
            meter.mark(mark, value)  # type: ignore[arg-type]
        now_ns += US
        meter.look()
        looked, connected, sent, checked, stored = meter.pulses[-1]
        assert (looked, connected, sent, stored) == (US, US, US, US)
        # Between probe and pulse, and after the pulse: the messages' own time is not in it.
        assert checked == 5 * US + US

    def test_what_a_reading_of_the_clock_takes_is_taken_out(self) -> None:
        readings = each_reading_takes(300)
        meter = StageMeter(lambda: next(readings))
        for _ in range(2):
            meter.look()
            for mark in ("rest", "set", "message", "ended", "set"):
                meter.mark(mark, 1)
        meter.look()
        assert meter.pulses[-1] == [0] * len(STAGES)

    def test_median_and_percentile_are_of_each_stage(self) -> None:
        stages = stages_of([[n * US] * len(STAGES) for n in range(1, 102)])
        assert [stage.name for stage in stages] == list(STAGES)
        assert {(stage.median_us, stage.p99_us) for stage in stages} == {(51.0, 100.0)}


class LateClock(MovedClock):
    """Every sleep ends 40 us late, and one in a hundred 900 us."""

    def __init__(self) -> None:
        super().__init__()
        self.sleeps = 0

    def doze_until_ns(self, deadline_ns: int) -> None:
        self.sleeps += 1
        self.t_ns = deadline_ns + (900 * US if self.sleeps % 100 == 0 else 40 * US)


def test_wake_ups_are_late_by_what_the_clock_says() -> None:
    found = measure_wakeups(LateClock(), seconds=0.4, cores=())
    assert found.idle.median_us == found.busy.median_us == 40.0
    assert found.worst_us == 900.0
    # One in a hundred is late: more than one in 256.
    assert found.spun_us == 50.0
    assert found.beyond == 7


def test_the_boards_calls_are_timed_with_the_supply_off_and_the_dac_at_zero() -> None:
    rig = board_rig("reference-hv507")
    assert rig.board.safe_off() == ()
    before = len(rig.records())
    found = measure_messages(rig.board, rig.clock)
    story = rig.story(before)
    assert found.problem is None
    assert PI4.word_us.low <= found.word_us <= PI4.word_us.high
    assert found.gpio_call_us == pytest.approx(PI4.gpio_call_us, rel=0.5)
    # Every line is set to the level that it has; every word is code 0.
    assert set(story) == {"BL=0", "POL=1", "HV=0", "dac=0000"}


def test_a_board_that_the_machine_file_does_not_fit_is_measured_and_told() -> None:
    slow = msgspec.structs.replace(PI4, word_us=Bounds(low=30.0, high=40.0))
    rig = board_rig("reference-hv507", machine=slow)
    found = measure_messages(rig.board, rig.clock)
    assert found.word_us < 30.0
    assert "one word" in str(found.problem)


FIGURES = st.floats(0.5, 500.0)


def result_of(computing_us: float, messages: Messages | None) -> Result:
    stage = Stage("whole", computing_us, 2 * computing_us)
    return Result(
        version=1,
        date="2026-01-01T00:00:00+00:00",
        etd="0.1.0",
        python="3.11.2",
        code="interpreted",
        machine="pi4",
        facts=('model: a "quoted" one',),
        not_granted=("locked memory was not granted",),
        computing=tuple(Computing(kind, 63, stage, (stage,)) for kind in KINDS),
        wakeups=Wakeups(stage, stage, 3.0, 12.5, 2),
        loop=LoopFigures(stage, 4.0, 20.9, 19.2, None),
        messages=messages,
        no_board=None if messages else "no board",
    )


class TestMachineFile:
    @given(computing_us=FIGURES, message_us=FIGURES, call_us=FIGURES, word_us=st.floats(0.5, 22.6))
    def test_what_was_found_comes_back_from_the_file(
        self, computing_us: float, message_us: float, call_us: float, word_us: float
    ) -> None:
        messages = Messages(word_us, 0.5, message_us, 1.0, call_us, None)
        result = result_of(computing_us, messages)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "machine.toml"
            path.write_text(toml_of(measured_machine(PI4, result), result))
            found = load_machine(path)
        assert found.visit_us == pytest.approx(computing_us, abs=0.06)
        assert found.gpio_call_us == pytest.approx(call_us, abs=0.006)
        for bounds, each_us in ((found.word_us, word_us), (found.message_us, message_us)):
            assert bounds.low < each_us < bounds.high

    def test_the_guards_worst_case_and_what_halts_are_never_taken_from_a_bench(self) -> None:
        result = result_of(900.0, Messages(20.0, 0.5, 300.0, 200.0, 90.0, "slow"))
        found = measured_machine(PI4, result)
        for key in ("guard_word_us", "guard_delay_extra_us", "halt_excess_us", "drift_us"):
            assert getattr(found, key) == getattr(PI4, key)
        assert found.spread_us == PI4.spread_us

    @pytest.mark.parametrize(
        ("messages", "key"),
        [
            pytest.param(Messages(25.0, 0.5, 9.0, 1.0, 4.0, None), "word_us", id="word"),
            pytest.param(Messages(16.0, 1.1, 9.0, 1.0, 4.0, None), "delay_extra_us", id="delay"),
        ],
    )
    def test_a_machine_above_the_guards_worst_case_gets_no_file(
        self, messages: Messages, key: str
    ) -> None:
        with pytest.raises(FileError) as caught:
            measured_machine(PI4, result_of(60.0, messages))
        assert caught.value.key == key
        assert f"guard_{key}" in str(caught.value)

    def test_without_a_board_only_the_processors_time_is_new(self) -> None:
        result = result_of(123.0, None)
        found = measured_machine(PI4, result)
        assert msgspec.structs.replace(found, name=PI4.name, visit_us=PI4.visit_us) == PI4
        assert found.visit_us == 123.0
        assert "Only visit_us is measured" in toml_of(found, result)


class TestTable:
    def test_it_has_every_figure_beside_the_machine_files(self) -> None:
        messages = Messages(16.2, 0.4, 13.0, 0.3, 4.5, "timing calibration, one word")
        machine = msgspec.structs.replace(PI4, visit_us=60.0)
        text = "\n".join(lines_of(result_of(66.0, messages), machine))
        for part in (
            "66.0",
            "1.10 times",
            "16.20   12.0 to 24.0",
            "locked memory",
            "one word",
            "12 us; 2",
        ):
            assert part in text

    def test_a_loop_that_halted_is_told(self) -> None:
        result = result_of(66.0, None)
        assert isinstance(result.loop, LoopFigures)
        figures = msgspec.structs.replace(result.loop, ended_by="fault: 545 us over its plan")
        for loop in (figures, "fault: 545 us over its plan"):
            told = msgspec.structs.replace(result, loop=loop)
            assert "did not stay armed" in "\n".join(lines_of(told, PI4))
