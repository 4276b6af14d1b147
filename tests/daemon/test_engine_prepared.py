"""Messages that were never sent before: what they cost before they are timed is no current.

A driver lays a message out in memory before its first sending, and the fake takes its time for it.
Every step of a fade and of the soft start is a new message for each electrode.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from engine_rig import EngineRig
from engine_scenes import armed, fully_open, only, phases

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16


def faded(steps: int) -> Iterator[tuple[int, ...]]:
    """From weak to strong, each electrode by currents of its own."""
    for step in range(steps):
        yield tuple(600 + 20 * step + electrode for electrode in range(N))


@pytest.mark.parametrize("board", ["kajimoto-hv507", "feetthrough-relay"])
def test_a_fade_whose_every_frame_has_new_currents_is_never_calibrated_again(
    make_rig: MakeRig, board: str
) -> None:
    rig = fully_open(make_rig(board, electrodes=N), 1_000)
    for current_ua in faded(20):
        assert rig.show(current_ua=current_ua, rate_hz=20.0, allow_slower=True).error is None
        rig.run_ms(60)
    assert rig.state == "ARMED"
    assert rig.engine.components.reporter.counters["recalibrated"] == 0


def test_a_soft_start_is_never_calibrated_again(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.hold(700, current_ua=(3_000,) * N, rate_hz=50.0)
    assert len({phase.current_ua for phase in phases(rig)}) > 30
    assert rig.engine.components.reporter.counters["recalibrated"] == 0


def test_the_ledger_books_no_time_that_a_message_took_before_it_began(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    ledger, since_ns = rig.engine.components.ledger, rig.clock.now_ns()
    before_pc = ledger.charge_pc(5, since_ns)
    for current_ua in range(901, 921):
        rig.show(current_ua=only(N, e5=current_ua), width_us=100, pulses=1)
        rig.run_ms(20)
    assert len(phases(rig, since_ns)) == 20
    booked_pc = ledger.charge_pc(5, rig.clock.now_ns()) - before_pc
    # A message is planned in whole nanoseconds: of each at most one is over.
    assert 0 <= booked_pc - sum(range(901, 921)) * 100 <= 20
