"""A board that could not be made safe is not given up: it is tried again until it is safe."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from itertools import pairwise

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import armed, halts, moves, only, states
from etd.engine.supply import AGAIN_NS, Supply
from etd.protocol.link import ClearHalt, DisarmBoard, StopNow
from etd_hal.backend import Backend
from etd_hal.cutlatch import POWER
from etd_hal.errors import BusError
from etd_hal.ports import Changes, Edge, Gpio

MakeRig = Callable[..., EngineRig]
BOARDS = ["kajimoto-hv507", "reference-hv507", "feetthrough-relay"]
ENABLED = ["reference-hv507", "feetthrough-relay"]
AGAIN_MS = AGAIN_NS / 1e6


class Failing:
    """Lines whose next calls fail, or succeed, with nothing done."""

    def __init__(self, gpio: Gpio) -> None:
        self._gpio = gpio
        self.fails = 0
        self.does_nothing = 0
        self.failed_ns: list[int] = []
        self.now_ns: Callable[[], int] = lambda: 0

    def set(self, changes: Changes) -> None:
        if self.fails:
            self.fails -= 1
            self.failed_ns.append(self.now_ns())
            raise BusError("io", "gpio", "set", "EIO")
        if self.does_nothing:
            self.does_nothing -= 1
            return
        self._gpio.set(changes)

    def get(self, line: int) -> int:
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self._gpio.edges()


def shown(make_rig: MakeRig, board: str) -> tuple[EngineRig, Failing]:
    """A frame is shown, and the lines are about to fail when they are told to."""
    lines: list[Failing] = []

    def wrap(backend: Backend) -> Backend:
        lines.append(Failing(backend.gpio))
        return dataclasses.replace(backend, gpio=lines[0])

    rig = armed(make_rig(board, wrap=wrap))
    lines[0].now_ns = rig.clock.now_ns
    count = rig.engine.components.loaded.array.count
    rig.show(current_ua=only(count, e1=400), ttl_ms=1_000)
    rig.run_ms(60)
    return rig, lines[0]


def is_on(rig: EngineRig) -> bool:
    """By the wire."""
    return moves(rig, "HV")[-1][1] == 1


@pytest.mark.parametrize("board", ENABLED)
@pytest.mark.parametrize("fails", [1, 2, 7])
def test_a_supply_that_was_not_switched_off_is_switched_off_at_the_next_attempt(
    make_rig: MakeRig, board: str, fails: int
) -> None:
    rig, lines = shown(make_rig, board)
    lines.fails = fails
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    rig.run_ms(fails * (AGAIN_MS + 6.0) + 60.0)
    assert rig.state == "HALTED"
    (halt,) = halts(rig)
    assert (halt.cause, halt.source) == ("fault", "safe_off")
    assert not is_on(rig)
    assert not states(rig)[-1].supply_on


@pytest.mark.parametrize("board", ENABLED)
def test_lines_that_succeed_and_do_not_move_are_no_safe_board(
    make_rig: MakeRig, board: str
) -> None:
    rig, lines = shown(make_rig, board)
    lines.does_nothing = 1
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    rig.run_ms(AGAIN_MS + 60.0)
    assert rig.state == "HALTED"
    (halt,) = halts(rig)
    assert (halt.cause, halt.source) == ("fault", "safe_off")
    assert "when read back" in halt.detail
    assert not is_on(rig)
    assert not states(rig)[-1].supply_on


@pytest.mark.parametrize("board", BOARDS)
def test_until_the_board_is_safe_the_stopper_is_awake_and_the_note_stands(
    make_rig: MakeRig, board: str
) -> None:
    rig, lines = shown(make_rig, board)
    words, watched = rig.engine.components.board.cut.words, []
    before = rig.engine.supervisor.supply.watched

    def watch(is_needed: bool) -> None:
        watched.append(is_needed)
        before(is_needed)

    rig.engine.supervisor.supply.watched = watch
    lines.fails = 1_000
    rig.ask(StopNow, client="operator")
    rig.run_ms(200)
    assert rig.state == "HALTED"
    assert watched == []
    assert words[POWER] & 1
    lines.fails = 0
    rig.run_ms(60)
    assert set(watched) == {False}
    assert not words[POWER] & 1


def test_attempts_leave_the_processor_time_and_a_halt_is_not_cleared_meanwhile(
    make_rig: MakeRig,
) -> None:
    rig, lines = shown(make_rig, "kajimoto-hv507")
    lines.fails = 1_000
    rig.ask(StopNow, client="operator")
    rig.run_ms(500)
    refused = rig.ask(ClearHalt)
    assert refused.error == "halted"
    assert "the board is not safe" in refused.reason
    # An attempt makes its calls at once, and the next one comes at a poll.
    gaps_ns = [after - before for before, after in pairwise(lines.failed_ns)]
    attempts = sum(gap_ns > 1_000_000 for gap_ns in gaps_ns)
    assert 10 <= attempts <= 500 / AGAIN_MS + 1
    lines.fails = 0
    rig.run_ms(30)
    assert rig.ask(ClearHalt).error is None
    assert rig.state == "SAFE"


def test_an_attempt_is_made_when_the_last_one_has_been_over_for_long_enough(
    make_rig: MakeRig,
) -> None:
    rig, lines = shown(make_rig, "reference-hv507")
    supply = rig.engine.supervisor.supply
    assert AGAIN_NS == 10_000_000
    assert not supply.again(rig.clock.now_ns()), "nothing has failed"
    assert is_on(rig)
    lines.fails = 1
    assert any("EIO" in problem for problem in supply.off())
    again_ns = rig.clock.now_ns() + AGAIN_NS
    assert not supply.again(again_ns - 1)
    assert is_on(rig)
    assert supply.again(again_ns)
    assert not is_on(rig)
    assert not supply.again(again_ns + AGAIN_NS)


def test_a_halt_that_was_cleared_wakes_the_stopper_for_its_note(make_rig: MakeRig) -> None:
    rig, _ = shown(make_rig, "kajimoto-hv507")
    words, watched = rig.engine.components.board.cut.words, []
    rig.ask(StopNow, client="operator")
    rig.engine.supervisor.supply.watched = lambda is_needed: watched.append(
        (is_needed, words[POWER])
    )
    before = words[POWER]
    assert rig.ask(ClearHalt).error is None
    assert watched == [(False, before), (False, before + 2)], "made safe once more, then cleared"


@pytest.mark.parametrize("is_powered", [True, False])
def test_a_defect_on_a_board_that_could_not_be_made_safe_leaves_the_note(
    make_rig: MakeRig, is_powered: bool
) -> None:
    """Halted, its supply may be on all the same."""
    rig, lines = shown(make_rig, "reference-hv507")
    lines.fails = 1_000
    rig.ask(StopNow, client="operator")
    words = rig.engine.components.board.cut.words
    told = words[POWER]
    assert told & 1
    lines.fails = 0
    rig.engine.supervisor.supply.remember_defect(is_powered=is_powered)
    assert rig.engine.supervisor.end() == ()
    assert words[POWER] == told


def test_without_a_stopper_nobody_is_woken(make_rig: MakeRig) -> None:
    parts = make_rig("kajimoto-hv507").engine.components
    alone = Supply(parts.board, parts.stopper_liveness, parts.clock)
    assert alone.off() == ()
