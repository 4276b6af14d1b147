"""A board that could not be made safe is not given up: it is tried again until it is safe."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from itertools import pairwise

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import armed, halts, moves, only, states
from etd.engine.supply import AGAIN_NS
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
    """Lines whose next calls fail, with nothing done."""

    def __init__(self, gpio: Gpio) -> None:
        self._gpio = gpio
        self.fails = 0
        self.failed_ns: list[int] = []
        self.now_ns: Callable[[], int] = lambda: 0

    def set(self, changes: Changes) -> None:
        if self.fails:
            self.fails -= 1
            self.failed_ns.append(self.now_ns())
            raise BusError("io", "gpio", "set", "EIO")
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
