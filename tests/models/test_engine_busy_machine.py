"""A fake on a machine that is held up now and then, anywhere: late, and never faulty."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import engine_rig
from engine_rig import EngineRig
from engine_scenes import MS, halts, only, phases, shortfalls
from etd.protocol.link import ArmBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.ports import Wait
from trace_rules import violations

#: So that no frame expires, however long the machine is held up.
TIMEOUT_FACTOR = 500
MOST_STALLED_NS = 300 * MS
#: On the machine's clock.
PATIENCE_MS = 1_000_000


class HeldUpClock(SteppedClock):
    """A machine's clock: at any reading, and at the end of any sleep, it may have gone on by much.
    Meanwhile the other threads get their turn.
    """

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._chance = random.Random(seed)
        self.others: Callable[[], object] = lambda: None

    def now_ns(self) -> int:
        self._stall()
        return super().now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        super().sleep_until_ns(deadline_ns)
        self._stall()
        self.others()

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        super().doze_until_woken(deadline_ns, wait)
        self._stall()
        self.others()

    def _stall(self) -> None:
        self.spend(1_000)
        if self._chance.random() < 0.01:
            self.spend(self._chance.randrange(MOST_STALLED_NS))


def armed_rig(board: str, machine: HeldUpClock) -> EngineRig:
    rig = engine_rig.make(
        board,
        electrodes=16,
        machine_clock=machine,
        wrap=lambda backend: replace(backend, timeout_factor=TIMEOUT_FACTOR),
    )
    # The stopper has no thread that is never held up: it looks when the machine gives it a turn.
    rig.stopper.is_looking = False
    machine.others = rig.stopper.check
    rig.open(1_000)
    if rig.engine.components.loaded.board.guards.wearer_stop != "absent":
        rig.try_wearer_stop()
    assert rig.ask(ArmBoard, PATIENCE_MS).error is None
    return rig


@pytest.mark.parametrize("board", ["kajimoto-hv507", "reference-hv507", "feetthrough-relay"])
@settings(max_examples=5)
@given(seed=st.integers(0, 2**32))
def test_it_fires_all_that_is_asked_and_nothing_is_overdue_overrun_or_too_long(
    board: str, seed: int
) -> None:
    machine = HeldUpClock(seed)
    rig = armed_rig(board, machine)
    begun_ns = rig.engine.components.clock.now_ns()
    frame = {"current_ua": only(16, e3=1_000, e9=1_000), "rate_hz": 30.0}
    answer = rig.wait_for(rig.send(**frame, ttl_ms=1_000, pulses=20), PATIENCE_MS)
    assert answer.error is None
    while rig.engine.components.active.schedule is not None:
        rig.step()
    fired = [phase.electrode for phase in phases(rig, begun_ns)]
    assert (fired.count(3), fired.count(9)) == (20, 20)
    assert rig.state == "ARMED"
    assert halts(rig) == []
    assert not rig.engine.components.stopper_liveness.has_acted
    assert rig.engine.components.reporter.counters["recalibrated"] == 0
    assert shortfalls(rig) == []
    late_ns = machine.now_ns() - rig.engine.components.clock.now_ns()
    assert late_ns > MOST_STALLED_NS, "the machine was not held up"
    assert rig.close() == ()
    assert violations(rig.trace(), rig.engine.components.loaded.board.rest_us) == []
