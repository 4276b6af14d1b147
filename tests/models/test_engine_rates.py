"""How often each electrode is visited: mean rates over seconds, order, thinning, lateness."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from itertools import pairwise

import pytest

from board_rig import changed
from engine_rig import EngineRig
from engine_scenes import MS, config, fully_open, only, phases, shortfalls
from etd_hal.backend import Backend
from etd_hal.fake.faults import SpiStall
from etd_hal.ports import Changes, Edge
from trace_decoder import Phase, visits

MakeRig = Callable[..., EngineRig]
N = 16
#: The line of the kit's board.
BL = 23


def gaps_ns(fired: list[Phase]) -> list[int]:
    return [after.from_ns - before.from_ns for before, after in pairwise(fired)]


@pytest.mark.parametrize("rate_hz", [0.7, 7.3, 50.0, 120.0])
def test_the_mean_rate_over_seconds_is_the_one_asked_for(make_rig: MakeRig, rate_hz: float) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=400), rate_hz=rate_hz, ttl_ms=1_000)
    rig.run_ms(999)
    fired = [phase for phase in phases(rig, since_ns) if phase.electrode == 3]
    assert len(fired) in (int(rate_hz), int(rate_hz) + 1)
    assert all(gap_ns == pytest.approx(1e9 / rate_hz, abs=1.2e6) for gap_ns in gaps_ns(fired))


def test_electrodes_of_one_frame_may_have_rates_of_their_own(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rates = tuple(float(5 + 3 * electrode) for electrode in range(N))
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=(400,) * N, rate_hz=rates, ttl_ms=1_000)
    rig.run_ms(990)
    fired = [phase.electrode for phase in phases(rig, since_ns)]
    for electrode, rate_hz in enumerate(rates):
        assert fired.count(electrode) == pytest.approx(rate_hz, abs=1.5)


def test_all_are_visited_in_the_first_scan_whatever_their_rates(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=(400,) * N, rate_hz=(50.0,) + (1.0,) * 15, ttl_ms=1_000)
    rig.run_ms(15)
    fired = [phase.electrode for phase in phases(rig, since_ns)]
    assert fired[:N] == list(range(N))
    assert {*fired[N:]} <= {0}


def test_a_scan_goes_in_the_order_of_the_chain(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e14=400, e2=400, e7=400), pulses=2, polarity="biphasic")
    rig.run_ms(60)
    found = [
        [(phase.electrode, phase.is_anodic) for phase in pair]
        for pair in visits(phases(rig, since_ns))
    ]
    assert found == [[(electrode, True), (electrode, False)] for electrode in (2, 7, 14)] * 2


def test_polarities_may_be_mixed_in_one_frame(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    kinds = ("anodic", "cathodic", "biphasic", "biphasic_cathodic_first") * 4
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=(400,) * N, polarity=kinds, pulses=1, rate_hz=20.0)
    rig.run_ms(40)
    found = [[phase.is_anodic for phase in pair] for pair in visits(phases(rig, since_ns))]
    assert found == [[True], [False], [True, False], [False, True]] * 4


def test_a_slowed_frame_has_the_rate_that_the_answer_tells_and_is_not_late(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig("kajimoto-hv507"), 500)
    wanted = {"current_ua": (400,) * 64, "rate_hz": 120.0}
    refused = rig.show(**wanted)
    assert refused.error == "too_fast"
    since_ns = rig.clock.now_ns()
    answer = rig.show(allow_slower=True, ttl_ms=1_000, **wanted)
    assert answer.rate_hz == refused.achievable_hz
    assert [(shortfall.reason, shortfall.rate_hz) for shortfall in answer.slowed] == [
        ("rate", answer.rate_hz)
    ]
    rig.run_ms(950)
    assert answer.rate_hz is not None
    seconds = (rig.clock.now_ns() - since_ns) / 1e9
    fired = [phase.electrode for phase in phases(rig, since_ns)]
    for electrode in range(64):
        assert fired.count(electrode) == pytest.approx(seconds * answer.rate_hz, abs=1.1)
    assert not [shortfall for shortfall in shortfalls(rig) if shortfall.reason == "overrun"]


@pytest.mark.parametrize(
    ("board", "electrodes"),
    [("kajimoto-hv507", 64), ("etactilekit-hv513-x8", 256), ("feetthrough-relay", 32)],
)
@pytest.mark.parametrize("polarity", ["anodic", "biphasic"])
def test_the_achievable_rate_is_achieved_on_every_board(
    make_rig: MakeRig, board: str, electrodes: int, polarity: str
) -> None:
    rig = fully_open(make_rig(board), 300)
    wanted = {"current_ua": (300,) * electrodes, "polarity": polarity}
    since_ns = rig.clock.now_ns()
    answer = rig.show(allow_slower=True, rate_hz=100.0, ttl_ms=1_000, **wanted)
    assert answer.error is None, answer.reason
    assert answer.rate_hz is not None
    rig.run_ms(950)
    seconds = (rig.clock.now_ns() - since_ns) / 1e9
    fired = [visit[0].electrode for visit in visits(phases(rig, since_ns))]
    assert fired.count(0) == pytest.approx(seconds * answer.rate_hz, abs=1.1)
    assert not [
        shortfall for shortfall in shortfalls(rig) if shortfall.reason in ("overrun", "processor")
    ]


class HeldUpGpio:
    """Lines whose caller loses the processor for 60 ms, behind one of its calls that blank."""

    def __init__(self, backend: Backend) -> None:
        self._gpio = backend.gpio
        self._clock = backend.clock
        #: Which of the calls to come, the first being 1; 0: none.
        self.at_blanking = 0

    def set(self, changes: Changes) -> None:
        self._gpio.set(changes)
        if (BL, 0) in changes and self.at_blanking:
            self.at_blanking -= 1
            if not self.at_blanking:
                self._clock.sleep_until_ns(self._clock.now_ns() + 60 * MS)

    def get(self, line: int) -> int:
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self._gpio.edges()


@pytest.mark.parametrize("drift_us", [1.5, 90_000.0])
def test_a_scan_that_came_late_is_told_and_nothing_is_made_up_for(
    make_rig: MakeRig, drift_us: float
) -> None:
    """Behind a message that drifts or does not: timing may have to be calibrated on the way."""
    held_up: list[HeldUpGpio] = []

    def wrap(backend: Backend) -> Backend:
        held_up.append(HeldUpGpio(backend))
        return dataclasses.replace(backend, gpio=held_up[0])

    machine = {"halt_excess_us": 90_000.0, "drift_us": drift_us}
    rig = fully_open(make_rig(loaded=config(machine=machine), wrap=wrap), 500)
    rig.fake.world.put_in(SpiStall(900, at_message=5, at_transfer=0))
    held_up[0].at_blanking = 5
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=400), rate_hz=100.0, ttl_ms=500)
    rig.run_ms(300)
    assert (
        sum(shortfall.pulses for shortfall in shortfalls(rig) if shortfall.reason == "overrun") >= 1
    )
    fired = [phase for phase in phases(rig, since_ns) if phase.electrode == 3]
    gaps = gaps_ns(fired)
    assert min(gaps) > 8 * MS
    assert max(gaps) > 60 * MS


# --- rates across frames --------------------------------------------------------------------------


@pytest.mark.parametrize("every_ms", [3, 5, 16, 25, 60])
def test_a_stream_of_frames_does_not_change_how_often_an_electrode_is_visited(
    make_rig: MakeRig, every_ms: int
) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rates = (50.0,) * 15 + (5.0,)
    since_ns = rig.clock.now_ns()
    while rig.clock.now_ns() < since_ns + 1_000 * MS:
        rig.send(current_ua=only(N, e3=400, e15=300), rate_hz=rates)
        rig.run_ms(every_ms)
    seconds = (rig.clock.now_ns() - since_ns) / 1e9
    fired = [phase.electrode for phase in phases(rig, since_ns)]
    assert fired.count(3) == pytest.approx(50 * seconds, abs=2)
    assert fired.count(15) == pytest.approx(5 * seconds, abs=1.5)


def test_a_faster_frame_does_not_wait_for_the_period_of_a_slower_one(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.show(current_ua=only(N, e3=400), rate_hz=1.0, ttl_ms=1_000)
    rig.run_ms(100)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e5=400), rate_hz=50.0)
    rig.run_ms(30)
    assert phases(rig, since_ns)[0].from_ns - since_ns < 3 * MS


def test_a_frame_in_place_of_another_begins_at_the_next_start_of_a_scan(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.show(current_ua=only(N, e3=400), rate_hz=50.0, ttl_ms=1_000)
    rig.run_ms(205)
    last_ns = phases(rig)[-1].from_ns
    rig.show(current_ua=only(N, e5=400), rate_hz=50.0)
    rig.run_ms(30)
    first_ns = next(phase.from_ns for phase in phases(rig, last_ns) if phase.electrode == 5)
    assert first_ns - last_ns == pytest.approx(20 * MS, abs=MS)


def test_two_that_share_their_only_return_share_its_rate(make_rig: MakeRig) -> None:
    """It is alone on its side in the pulses of both, and the last guard counts it so."""
    loaded = config("feetthrough-relay", N)
    board = changed(loaded.board, "maxima", rate_hz=60)
    rig = fully_open(make_rig(loaded=dataclasses.replace(loaded, board=board)), 500)
    returns = tuple((6,) if electrode != 6 else (7,) for electrode in range(N))
    since_ns = rig.clock.now_ns()
    for _ in range(10):
        answer = rig.show(current_ua=only(N, e2=400, e4=400), returns=returns, rate_hz=40.0)
        assert answer.error is None, answer.reason
        rig.run_ms(150)
    assert rig.state == "ARMED"
    begun_ns = [phase.from_ns for phase in phases(rig, since_ns) if phase.electrode in (2, 4)]
    assert len(begun_ns) > 60
    assert all(
        one_too_many_ns - first_ns >= 999 * MS
        for first_ns, one_too_many_ns in zip(begun_ns, begun_ns[60:], strict=False)
    )
    assert "ledger" in {shortfall.reason for shortfall in shortfalls(rig)}
