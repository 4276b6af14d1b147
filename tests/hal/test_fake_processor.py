"""What computing costs on a modelled machine: told by the calls, charged on the fake's clock."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from board_rig import MACHINES as MACHINE_FILES
from etd_hal.board import Board
from etd_hal.boardfile import load_board, load_machine
from etd_hal.compose import open_fake
from etd_hal.fake.clock import LiveClock, SteppedClock
from etd_hal.fake.machines import MACHINES, PI4
from etd_hal.fake.processor import STAGES_NS, Call, Stage, StagedTime, Stages, ThreadTime
from etd_hal.modelled_machines import MODELLED_MACHINES
from hand_clock import HandClock

MS = 1_000_000
#: What comes of one pulse on a board with half-bridges, in the middle of a scan.
PULSE: Sequence[Call] = (
    *("now", "host", "line", "now", "sleep", "switch", "host", "now", "message", "now"),
    *("switch", "now", "switch", "switch"),
)


def told(stages: Stages, calls: Sequence[Call]) -> list[Stage]:
    return [stage for call in calls for stage in stages.behind(call)]


class TestStages:
    def test_each_pulse_of_a_scan_goes_through_all_of_them_once(self) -> None:
        stages = Stages()
        told(stages, ("mark", "now"))
        for _ in range(3):
            assert told(stages, PULSE) == ["clear", "fire", "judge", "report"]

    def test_nothing_is_computed_between_the_reading_of_the_clock_and_the_message(self) -> None:
        stages = Stages()
        told(stages, ("mark", *PULSE[: PULSE.index("message")]))
        assert stages.behind("message") == ()

    def test_a_poll_while_nothing_is_due_costs_less_than_one_before_a_pulse(self) -> None:
        stages = Stages()
        assert told(stages, ("now", "host", "now", "doze", "now", "host", "now", "doze")) == [
            "idle_poll",
            "idle_poll",
        ]
        assert STAGES_NS["idle_poll"] < STAGES_NS["clear"]

    def test_the_end_of_a_scan_clears_no_second_pulse(self) -> None:
        stages = Stages()
        told(stages, ("mark", *PULSE))
        assert told(stages, ("host", "now", "doze", "host")) == ["clear", "idle_poll"]

    def test_planning_is_told_by_the_machines_clock_read_again_and_again(self) -> None:
        """The poll looks at it, then what reads a frame, then each step of its plan."""
        stages = Stages()
        assert told(stages, ("now", "host", "line", "now", "now", "doze")) == ["idle_poll"]
        found = told(stages, ("now", "host", "now", "host", "now", "host", "host", "now", "mark"))
        assert found == ["idle_poll", *["plan_step"] * 3]

    def test_a_pulse_after_its_own_probe_is_cleared_anew(self) -> None:
        stages = Stages()
        told(stages, ("mark", *PULSE[: PULSE.index("message") + 2]))
        assert told(stages, ("host", "now", "message", "now", "switch")) == [
            *("judge", "clear", "fire"),
            "judge",
        ]

    def test_both_phases_of_a_pulse_are_judged(self) -> None:
        stages = Stages()
        told(stages, ("mark", *PULSE[: PULSE.index("message") + 2]))
        assert told(stages, ("switch", "now", "message", "switch")) == ["judge", "judge"]


class TestSteppedClock:
    def test_what_was_computed_is_over_when_the_next_call_begins(self) -> None:
        clock = SteppedClock(start_ns=0, processor=StagedTime(4.0, {**STAGES_NS, "judge": 7_000}))
        clock.end_call(clock.begin_message() + 100_000)
        assert clock.now_ns() == 100_000
        assert clock.begin_call("switch") == 128_000

    @pytest.mark.parametrize("slowness", [1.0, 4.0, 10.0])
    def test_a_pulse_costs_its_stages_times_the_slowness(self, slowness: float) -> None:
        clock = SteppedClock(start_ns=0, processor=StagedTime(slowness))
        clock.begin_call("mark")
        for call in PULSE:
            if call == "now":
                clock.now_ns()
            elif call == "host":
                clock.host.now_ns()
            elif call == "sleep":
                clock.sleep_until_ns(0)
            else:
                clock.begin_call(call)
        stages: tuple[Stage, ...] = ("clear", "fire", "judge", "report")
        assert clock.now_ns() == slowness * sum(STAGES_NS[stage] for stage in stages)

    def test_what_other_threads_do_costs_the_scan_nothing(self) -> None:
        clock = SteppedClock(start_ns=0, processor=StagedTime(10.0))
        read_ns: list[int] = []
        clock.at(50, lambda: read_ns.append(clock.host.now_ns()))
        clock.sleep_until_ns(100)
        assert read_ns == [50]
        assert clock.now_ns() == 100

    def test_without_a_processor_computing_takes_no_time(self) -> None:
        clock = SteppedClock(start_ns=0)
        clock.begin_call("mark")
        assert clock.host.now_ns() == clock.begin_message() == 0


class Working:
    """A thread's processor time, which a test moves by hand."""

    def __init__(self) -> None:
        self.t_ns = 70

    def __call__(self) -> int:
        return self.t_ns


class TestLiveClock:
    def test_computing_takes_so_many_times_as_long(self) -> None:
        real, working = HandClock(), Working()
        clock = LiveClock(real, ThreadTime(4.0, working))
        clock.end_call(clock.begin_message() + 100_000)
        ended_ns = clock.now_ns()
        working.t_ns += 30_000
        real.t_ns += 30_000
        assert clock.begin_call("switch") - ended_ns == 120_000
        assert clock.now_ns() <= real.t_ns

    def test_nothing_is_charged_between_a_message_and_the_readings_around_it(self) -> None:
        real, working = HandClock(), Working()
        clock = LiveClock(real, ThreadTime(10.0, working))
        clock.end_call(clock.begin_message())
        clock.begin_call("switch")
        before_ns = clock.now_ns()
        working.t_ns += 7_000
        clock.end_call(clock.begin_message() + 100_000)
        working.t_ns += 5_000
        assert clock.now_ns() - before_ns == 100_000

    def test_what_a_call_itself_computes_is_the_fakes_and_costs_nothing(self) -> None:
        real, working = HandClock(), Working()
        clock = LiveClock(real, ThreadTime(10.0, working))
        begun_ns = clock.begin_message()
        working.t_ns += 5 * MS
        clock.end_call(begun_ns + 100_000)
        assert clock.begin_call("switch") - begun_ns == 100_000

    def test_reading_the_machines_clock_waits_for_what_was_computed(self) -> None:
        real, working = HandClock(), Working()
        clock = LiveClock(real, ThreadTime(10.0, working))
        clock.end_call(clock.begin_message())
        before_ns = clock.host.now_ns()
        working.t_ns += 1 * MS
        assert clock.host.now_ns() - before_ns == 10 * MS


def test_every_modelled_machine_can_be_chosen() -> None:
    assert set(MACHINES) == set(MODELLED_MACHINES)
    assert MACHINES["pi4"] is PI4
    assert [MACHINES[name].slowness for name in MODELLED_MACHINES] == [4.0, 8.0, 10.0]


def test_a_fake_says_which_machine_it_models() -> None:
    board = load_board(MACHINE_FILES.parent / "boards" / "kajimoto-hv507.toml")
    for machine in MODELLED_MACHINES:
        backend = open_fake(board, electrodes=range(64), stepped=True, machine=machine)
        assert [fact for fact in backend.facts if machine in fact] != []
        backend.close()


@pytest.mark.parametrize("machine", [None, "pi4", "zero2w"])
def test_its_calls_take_the_time_of_that_machine(machine: str | None) -> None:
    board = load_board(MACHINE_FILES.parent / "boards" / "kajimoto-hv507.toml")
    backend = open_fake(board, electrodes=range(64), stepped=True, machine=machine)
    begun_ns = backend.clock.now_ns()
    backend.gpio.set(((board.used_lines()["CLK"], 0),))
    took_ns = backend.clock.now_ns() - begun_ns
    assert took_ns == (10_800 if machine == "zero2w" else 4_400)
    backend.close()


@pytest.mark.parametrize("name", MODELLED_MACHINES)
def test_live_messages_last_as_modelled_whatever_computing_costs(name: str) -> None:
    file = load_board(MACHINE_FILES.parent / "boards" / "kajimoto-hv507.toml")
    backend = open_fake(file, electrodes=range(64), machine=name)
    machine = load_machine(MACHINE_FILES / f"{name}.toml")
    ports = (backend.spi, backend.gpio, backend.clock)
    timing = Board(file, machine, backend.codec, *ports).calibrate()
    assert timing.spread_us < 0.01
    backend.close()
