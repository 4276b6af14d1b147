"""`etd bench` with the real engine behind it, on clocks that a test moves."""

from __future__ import annotations

from itertools import count

import msgspec
import pytest

from etd.bench.computing import measure_computing
from etd.bench.loop import LoopFigures, measure_loop
from etd.bench.messages import Messages
from etd.bench.result import Result
from etd.bench.run import Parts, measure
from etd.bench.stages import STAGES
from etd.bench.subject import ELECTRODES, KINDS
from etd.files.configuration import fake_config
from etd.protocol.errors import HardwareMissing
from etd_hal.bench import ScanCore
from etd_hal.compose import codec_of, wall_time
from etd_hal.unwired import MovedClock
from etd_hal.wakeups import WakeUps

LOADED = fake_config("kajimoto-hv507")
PI4, CODEC = LOADED.machine, codec_of(LOADED.board.source)
US = 1_000


class ReadClock(MovedClock):
    """A clock that moves by being read, too."""

    def __init__(self) -> None:
        super().__init__()
        self.wakeups = WakeUps()

    def now_ns(self) -> int:
        self.t_ns += 100
        return self.t_ns


def test_every_kind_of_pulse_is_measured_stage_by_stage() -> None:
    ticks = count(0, US)
    found = measure_computing(PI4, CODEC, ReadClock(), lambda: next(ticks), seconds=0.0)
    assert [kind.kind for kind in found] == list(KINDS)
    for kind in found:
        assert kind.pulses == ELECTRODES - 1
        assert len(kind.stages) == len(STAGES)


def test_a_loop_on_a_clock_that_only_reading_moves_is_late_by_its_readings() -> None:
    found = measure_loop(PI4, CODEC, ReadClock(), seconds=0.0)
    assert isinstance(found, LoopFigures)
    assert found.ended_by is None
    assert 0.0 <= found.late.median_us <= found.late.p99_us <= found.worst_us < 100.0
    assert found.least_ms == pytest.approx((ELECTRODES - 1) * (100 + LOADED.board.rest_us) / 1e3)
    assert found.least_ms < found.scan_ms < 1.2 * found.least_ms


def test_an_engine_that_halts_ends_the_loop_with_its_reason() -> None:
    class HeldUpClock(ReadClock):
        """From some time on a reading in a thousand is held up by a millisecond."""

        reads = 0

        def now_ns(self) -> int:
            self.reads += 1
            if self.t_ns > held_up_from_ns and self.reads % 1_000 == 0:
                self.t_ns += 1_000 * US
            return super().now_ns()

    held_up_from_ns = 0
    found = measure_loop(PI4, CODEC, HeldUpClock(), seconds=0.0)
    assert isinstance(found, str)
    held_up_from_ns = 5_000_000_000
    found = measure_loop(PI4, CODEC, HeldUpClock(), seconds=20.0)
    assert isinstance(found, LoopFigures)
    assert "over its plan" in str(found.ended_by)


def test_a_bench_that_was_stopped_for_seconds_says_that_it_was_held_up() -> None:
    class StoppedClock(ReadClock):
        """At some time the program is stopped for five seconds."""

        def doze_until_ns(self, deadline_ns: int) -> None:
            super().doze_until_ns(deadline_ns)
            if 5_000_000_000 < self.t_ns < 6_000_000_000:
                self.t_ns += 5_000_000_000

    found = measure_loop(PI4, CODEC, StoppedClock(), seconds=20.0)
    assert isinstance(found, LoopFigures)
    assert "held up" in str(found.ended_by)


def test_the_parts_follow_one_another_and_a_missing_board_is_told() -> None:
    told: list[str] = []
    asked: list[str] = []

    def no_board(_: object) -> Messages:
        raise HardwareMissing(("there is no /dev/gpiochip0",))

    def set_up() -> tuple[str, ...]:
        asked.append(told[-1])
        return ("real-time scheduling was not granted",)

    core = ScanCore(3, is_isolated=True, has_throttle=True, has_fair_server=None)
    now, facts = wall_time(), ("model: x",)
    parts = Parts(PI4, CODEC, ReadClock(), lambda: 0, now, facts, set_up, lambda: core, no_board)
    result = measure(parts, seconds=0.0, tell=told.append)
    assert asked == [told[0]]
    assert "processor" in told[0]
    assert result.messages is None
    assert "/dev/gpiochip0" in str(result.no_board)
    assert "at most 80 % of any 100 ms (core 3, isolated; real-time throttle on" in result.facts[1]
    assert result.not_granted == ("real-time scheduling was not granted",)
    assert msgspec.json.decode(msgspec.json.encode(result), type=Result) == result
