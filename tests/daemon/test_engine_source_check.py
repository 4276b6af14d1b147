"""The source's gain is checked with nothing connected: before arming, and each second while armed.

What skin resists cannot be told from a wrong gain, so that these gains are told by no pulse.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import msgspec
import pytest

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import armed, config, first_fault, halts, phases, states
from etd.files.configuration import LoadedConfig, fake_config
from etd.files.resources import names
from etd.protocol.link import ArmBoard, KeepLease
from etd_hal.fake.faults import AdcNoise, DacGain, DacOffset, Fault, GainAbove
from trace_decoder import Phase
from trace_rules import violations

pytestmark = pytest.mark.slow

BOARDS = names("boards")
#: One of each kind of switch and with every guard: what lasts is shown on these.
THREE = ("kajimoto-hv507", "reference-hv507", "feetthrough-relay")
N, CURRENT_UA = 16, 200
#: Until a fault is told: a second, the scan under way, and a check.
MOST_MS = 1_000 + 200 + 5
#: A check of the latch, before or after.
LIVE_WITHIN_NS = 300_000_000
Make = Callable[..., EngineRig]


@pytest.fixture
def make() -> Iterator[Make]:
    """Rigs that are ended with their faults taken out, and with nothing wrong on the wires."""
    made: list[EngineRig] = []

    def new(board: str | LoadedConfig, *, is_traced: bool = False) -> EngineRig:
        loaded = fake_config(board=board, electrodes=N) if isinstance(board, str) else board
        made.append(engine_rig.make(loaded=loaded, is_traced=is_traced))
        return made[-1]

    yield new
    for rig in made:
        rig.fake.world.mend()
        assert [text for text in rig.close() if "with the DAC at code" not in text] == []
        assert rig.fake.dac_code == 0


def checks(rig: EngineRig, since_ns: int = 0) -> list[Phase]:
    """The whole probe of each. A third of it comes with it: blanked before arming and where relays
    connect, otherwise with the outputs live.
    """
    found = [phase for phase in rig.followed.unloaded() if phase.from_ns >= since_ns]
    probe_ua = rig.engine.supervisor.maxima.probe_current_ua
    parts = [phase for phase in found if phase.current_ua <= probe_ua / 3]
    wholes = [phase for phase in found if 0.95 * probe_ua < phase.current_ua <= probe_ua]
    assert len(parts) + len(wholes) == len(found)
    live = [phase for phase in rig.followed.unselected() if phase.from_ns >= since_ns]
    assert all(
        any(abs(whole.from_ns - part.from_ns) < LIVE_WITHIN_NS for part in (*parts, *live))
        for whole in wholes
    )
    return wholes


def fastest_hz(rig: EngineRig) -> float:
    """A scan begins where the one before ends."""
    answer = rig.show(current_ua=(CURRENT_UA,) * N, rate_hz=100.0, allow_slower=True, ttl_ms=50)
    assert answer.error is None, answer.reason
    rig.run_ms(60)
    return answer.rate_hz or 100.0


def stand(rig: EngineRig, duration_ms: float, rate_hz: float | None) -> None:
    """Frames without a gap; or none (None), with the lease kept. Ends early with a halt."""
    until_ns = rig.clock.now_ns() + int(duration_ms * 1e6)
    while rig.clock.now_ns() < until_ns and rig.state == "ARMED":
        if rate_hz is None:
            rig.ask(KeepLease, lease=LEASE)
        else:
            rig.send(current_ua=(CURRENT_UA,) * N, rate_hz=rate_hz)
        rig.run_ms(min(50.0, (until_ns - rig.clock.now_ns()) / 1e6))


# --- while armed ----------------------------------------------------------------------------------


@pytest.mark.parametrize("is_idle", [False, True])
@pytest.mark.parametrize("factor", [1.5, 0.6])
@pytest.mark.parametrize("board", THREE)
def test_a_gain_that_becomes_wrong_halts_within_a_second(
    make: Make, board: str, factor: float, is_idle: bool
) -> None:
    rig = armed(make(board))
    rate_hz = None if is_idle else fastest_hz(rig)
    stand(rig, 300, rate_hz)
    begun_ns = rig.clock.now_ns()
    rig.fake.world.put_in(DacGain(factor))
    stand(rig, 3_000, rate_hz)
    assert first_fault(rig) == "BoardFault"
    assert halts(rig)[0].t_ns - begun_ns <= MOST_MS * 1e6
    assert "with nothing connected" in halts(rig)[0].detail
    assert "current x leak" in halts(rig)[0].detail


@pytest.mark.parametrize("board", THREE)
def test_one_that_is_wrong_above_a_third_of_a_probe_only_is_told_by_the_whole(
    make: Make, board: str
) -> None:
    rig = armed(make(board))
    stand(rig, 300, 5.0)
    begun_ns = rig.clock.now_ns()
    rig.fake.world.put_in(above_a_third(rig))
    stand(rig, 3_000, 5.0)
    assert halts(rig)[0].t_ns - begun_ns <= MOST_MS * 1e6
    assert "node at 297 uA with nothing connected" in halts(rig)[0].detail
    assert rig.engine.components.source_check.limitations == ()


@pytest.mark.parametrize("fault", [DacGain(1.1), DacGain(0.9), AdcNoise(1.5)])
@pytest.mark.parametrize("board", THREE)
def test_one_within_the_tolerance_does_not(make: Make, board: str, fault: Fault) -> None:
    rig = armed(make(board))
    rig.fake.world.put_in(fault)
    stand(rig, 1_100, 5.0)
    assert rig.state == "ARMED"


@pytest.mark.parametrize("board", THREE)
def test_a_current_at_code_0_is_told_within_a_second_where_no_pulse_is_fired(
    make: Make, board: str
) -> None:
    rig = armed(make(board))
    stand(rig, 300, None)
    begun_ns = rig.clock.now_ns()
    rig.fake.world.put_in(DacOffset(60))
    stand(rig, 3_000, None)
    assert "a current flows that was not commanded" in halts(rig)[0].detail
    assert halts(rig)[0].t_ns - begun_ns <= MOST_MS * 1e6


@pytest.mark.parametrize("is_idle", [False, True])
@pytest.mark.parametrize("board", THREE)
def test_there_is_one_each_second_and_no_scan_is_late_for_it(
    make: Make, board: str, is_idle: bool
) -> None:
    rig = armed(make(board, is_traced=True))
    rate_hz = None if is_idle else fastest_hz(rig)
    armed_ns = rig.clock.now_ns()
    stand(rig, 1_250, rate_hz)
    begun_ns = [phase.from_ns for phase in checks(rig)]
    assert len(begun_ns) == 2
    assert all(0.99e9 <= after - before <= MOST_MS * 1e6 for before, after in pairwise(begun_ns))
    assert rig.engine.components.reporter.counters["not_fired_overrun"] == 0
    if rate_hz is not None:
        scans_hz = len({phase.scan for phase in phases(rig, armed_ns)}) / 1.25
        assert scans_hz == pytest.approx(rate_hz, rel=0.05)


@pytest.mark.parametrize("board", THREE)
def test_no_electrode_gets_any_of_it_and_none_is_booked(make: Make, board: str) -> None:
    rig = armed(make(board, is_traced=True))
    # The body adds what is left of the probes before to its account at its next change: by then.
    stand(rig, 1_200, None)
    body, ledger = rig.fake.world.body, rig.engine.components.ledger
    before_pc = [body.absolute_charge_pc(electrode) for electrode in range(N)]
    since_ns = rig.clock.now_ns()
    stand(rig, 1_000, None)
    assert len(checks(rig, since_ns)) == 1
    assert [body.absolute_charge_pc(electrode) for electrode in range(N)] == before_pc
    assert all(ledger.charge_pc(electrode, rig.clock.now_ns()) == 0 for electrode in range(N))


@pytest.mark.parametrize("board", ["kajimoto-hv507", "feetthrough-relay"])
def test_nothing_is_wrong_on_the_wires(make: Make, board: str) -> None:
    rig = armed(make(board, is_traced=True))
    stand(rig, 1_200, 5.0)
    rig.engine.supervisor.make_safe("done")
    assert len(checks(rig)) == 2
    assert violations(rig.trace(), rig.engine.components.loaded.board.rest_us) == []


def test_after_a_stop_there_is_none(make: Make) -> None:
    rig = armed(make("reference-hv507", is_traced=True))
    stand(rig, 500, 60.0)
    rig.fake.world.press("emergency_stop")
    rig.run_ms(5)
    since_ns = rig.clock.now_ns()
    rig.run_ms(2_000)
    assert rig.state == "HALTED"
    assert checks(rig, since_ns) == []


# --- before arming --------------------------------------------------------------------------------


#: For `above_a_third`, which depends on the board.
ABOVE = GainAbove(code=0, factor=1.5)


def above_a_third(rig: EngineRig) -> Fault:
    """Right in the first pulse of a check, and half as strong again in the second."""
    code = rig.engine.components.loaded.board.source.code_for(CURRENT_UA)
    return msgspec.structs.replace(ABOVE, code=code)


@pytest.mark.parametrize("fault", [DacGain(1.5), DacGain(0.6), DacOffset(60), ABOVE])
@pytest.mark.parametrize("board", BOARDS)
def test_arming_is_refused_before_the_first_pulse_at_a_person(
    make: Make, board: str, fault: Fault
) -> None:
    rig = make(board, is_traced=True)
    rig.open()
    if rig.engine.components.loaded.board.guards.wearer_stop != "absent":
        rig.try_wearer_stop()
    fault = above_a_third(rig) if fault is ABOVE else fault
    rig.fake.world.put_in(fault)
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "with nothing connected: measured" in str(answer.reason).replace(
        " V with", " V: with"
    ) or ("with nothing connected" in str(answer.reason))
    assert rig.state == "SAFE"
    assert phases(rig) == []
    rig.fake.world.take_out(fault)
    rig.ask(KeepLease, lease=LEASE)
    assert rig.ask(ArmBoard).error is None


def test_a_board_on_which_it_tells_nothing_is_armed_and_says_so(make: Make) -> None:
    loaded = config("kajimoto-hv507", N)
    weak = msgspec.structs.replace(loaded.board.maxima, probe_current_ua=90)
    loaded = replace(loaded, board=msgspec.structs.replace(loaded.board, maxima=weak))
    rig = armed(make(loaded, is_traced=True))
    stand(rig, 1_500, 20.0)
    assert rig.state == "ARMED"
    assert checks(rig) == []
    told = states(rig)[-1].not_granted
    assert any("the source is not checked while armed" in sentence for sentence in told)


@pytest.mark.parametrize("board", BOARDS)
def test_every_shipped_board_has_the_check(make: Make, board: str) -> None:
    rig = armed(make(board))
    stand(rig, 1_100, None)
    assert not any("not checked" in sentence for sentence in states(rig)[-1].not_granted)
