"""A latch or chain that does not follow sends all pulses to one electrode, on even skin as well."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from charge_witness import even_skin
from engine_rig import EngineRig
from engine_scenes import MS, config, first_fault, fully_open, halts, phases
from etd.protocol.link import ArmBoard
from etd_hal.fake.faults import DacGain, Fault, StuckBehind, SwitchOutput

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N, CURRENT_UA = 16, 1_000
#: A tenth of a second, the scan under way and a check.
MOST_MS = 100 + 40 + 5
HALF_BRIDGES = ["kajimoto-hv507", "reference-hv507"]
#: Each leaves the electrode that was selected last where it was.
STUCK: list[Fault] = [
    StuckBehind("LE", 0),
    StuckBehind("CLK", 0),
    StuckBehind("CLK", 1),
]


def shown(make_rig: MakeRig, board: str) -> EngineRig:
    loaded = config(board, electrodes=N)
    rig = make_rig(loaded=loaded, body=even_skin(loaded.board, N), is_traced=True)
    fully_open(rig)
    return rig


def stand(rig: EngineRig, duration_ms: float) -> None:
    until_ns = rig.clock.now_ns() + int(duration_ms * 1e6)
    while rig.clock.now_ns() < until_ns and rig.state == "ARMED":
        rig.send(current_ua=(CURRENT_UA,) * N, width_us=50, rate_hz=25.0, ttl_ms=200)
        rig.run_ms(50)


@pytest.mark.parametrize("fault", STUCK, ids=str)
@pytest.mark.parametrize("board", HALF_BRIDGES)
def test_it_halts_within_a_tenth_of_a_second(make_rig: MakeRig, board: str, fault: Fault) -> None:
    """On skin that is the same everywhere, where no pulse reads otherwise than it should."""
    rig = shown(make_rig, board)
    stand(rig, 200)
    begun_ns = rig.clock.now_ns()
    rig.fake.world.put_in(fault)
    stand(rig, 1_000)
    assert first_fault(rig) == "BoardFault"
    halt = halts(rig)[0]
    assert halt.t_ns - begun_ns <= MOST_MS * 1e6
    assert "pulses reach another electrode" in halt.detail or "readback" in halt.detail


def test_an_output_that_stays_on_the_source_is_found_by_the_same(make_rig: MakeRig) -> None:
    rig = shown(make_rig, "kajimoto-hv507")
    rig.fake.world.put_in(SwitchOutput(5, "source"))
    stand(rig, 500)
    assert "with nothing connected" in halts(rig)[0].detail


@pytest.mark.parametrize("board", HALF_BRIDGES)
def test_a_source_that_is_wrong_is_told_as_that(make_rig: MakeRig, board: str) -> None:
    rig = shown(make_rig, board)
    rig.fake.world.put_in(DacGain(0.5))
    stand(rig, 500)
    assert "with nothing connected" in halts(rig)[0].detail


@pytest.mark.parametrize("board", HALF_BRIDGES)
def test_a_board_in_order_is_looked_at_ten_times_a_second_and_no_electrode_gets_any_of_it(
    make_rig: MakeRig, board: str
) -> None:
    rig = shown(make_rig, board)
    stand(rig, 1_000)
    since_ns = rig.clock.now_ns()
    stand(rig, 1_000)
    assert rig.state == "ARMED"
    found = [phase for phase in rig.followed.unselected() if phase.from_ns >= since_ns]
    assert 7 <= len(found) <= 11
    assert all(phase.source == frozenset() for phase in found)
    probe_ua = rig.engine.supervisor.maxima.probe_current_ua
    assert all(phase.current_ua <= probe_ua / 3 for phase in found)
    # All that was fired at an electrode was asked for.
    fired = [phase for phase in phases(rig, since_ns) if not phase.is_weak]
    assert {phase.electrode for phase in fired} == set(range(N))


def test_arming_is_refused_with_a_latch_that_is_stuck(make_rig: MakeRig) -> None:
    rig = shown(make_rig, "kajimoto-hv507")
    stand(rig, 100)
    rig.send(current_ua=(CURRENT_UA,) * N, width_us=50, rate_hz=25.0, ttl_ms=200)
    rig.run_ms(25)
    rig.fake.world.put_in(StuckBehind("LE", 0))
    rig.engine.supervisor.make_safe("done")
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "is still on the source" in str(answer.reason)


def test_the_latch_is_looked_at_while_a_frame_waits_for_an_edge_that_does_not_come(
    make_rig: MakeRig,
) -> None:
    rig = shown(make_rig, "kajimoto-hv507")
    stand(rig, 200)
    rig.fake.world.put_in(StuckBehind("LE", 0))
    waits_ns = rig.clock.now_ns()
    while rig.state == "ARMED" and rig.clock.now_ns() - waits_ns < 2_000 * MS:
        rig.send(current_ua=(CURRENT_UA,) * N, width_us=50, ttl_ms=100, on_trigger=True)
        rig.run_ms(50)
    assert first_fault(rig) == "BoardFault"
    assert halts(rig)[0].t_ns - waits_ns <= 250 * MS
