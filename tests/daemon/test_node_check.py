"""What the node may read in each message of a visit, on a chain and on relays."""

from __future__ import annotations

import pytest

from board_rig import board_rig
from etd.engine.node_check import NodeCheck
from etd.firing import ReadyPulse
from etd.protocol.errors import BoardFault
from etd.pulse.request import PulseRequest
from etd.safety.bookings import Entry
from etd_hal.board import Board
from etd_hal.phase import PulseResult
from etd_hal.source_rules import RESTED_V

CHAIN, RELAYS = "kajimoto-hv507", "feetthrough-relay"
HERE, CURRENT_UA, WIDTH_US = 5, 1_000, 100
LITTLE_V = 0.01
#: What a probe has left.
HELD_V = 20.0


class Visits:
    """Messages with what was read in them, one after another."""

    def __init__(self, board: str = CHAIN) -> None:
        rig = board_rig(board)
        rig.begin()
        self.board: Board = rig.board
        self._check = NodeCheck(self.board)
        self.noise_v = self.board.rules.noise_v

    def most_v(self, baseline_v: float) -> float:
        """In a pulse."""
        commanded_ua = self.board.pulse(CURRENT_UA, WIDTH_US).commanded_ua
        return self.board.rules.most_v(commanded_ua, baseline_v)

    def message(
        self,
        baseline_v: float = 0.0,
        node_v: float = 10.0,
        early_v: float = 0.0,
        *,
        pulses: int = 1,
        is_anodic: bool = True,
    ) -> None:
        """`pulses` 0: it goes on with a visit that its probe has begun."""
        returns = (6, 9) if self.board.switch.can_choose_returns else None
        ready = ReadyPulse(
            Entry(HERE, CURRENT_UA * WIDTH_US, WIDTH_US, returns, 1.0, pulses),
            self.board.selection(HERE, returns),
            (is_anodic,),
            self.board.pulse(CURRENT_UA, WIDTH_US),
            PulseRequest(CURRENT_UA, WIDTH_US),
        )
        self._check.check(ready, is_anodic, PulseResult(0, 0, 0, baseline_v, node_v, early_v))

    def refused(self, baseline_v: float, *, pulses: int = 1, is_anodic: bool = True) -> str:
        """What is said of it."""
        with pytest.raises(BoardFault) as refusal:
            self.message(baseline_v, pulses=pulses, is_anodic=is_anodic)
        assert f"{baseline_v:.1f} V" in str(refusal.value)
        return str(refusal.value)


@pytest.mark.parametrize("is_anodic", [True, False])
@pytest.mark.parametrize("pulses", [0, 1])
def test_before_the_first_message_the_node_has_rested(pulses: int, *, is_anodic: bool) -> None:
    """There is nothing before it that could have left anything, whatever it goes on with."""
    Visits().message(RESTED_V, pulses=pulses, is_anodic=is_anodic)
    said = Visits().refused(RESTED_V + LITTLE_V, pulses=pulses, is_anodic=is_anodic)
    assert f"node before the pulse at electrode {HERE}" in said
    assert "at most 5.0 V" in said


@pytest.mark.parametrize("is_anodic", [True, False])
def test_a_pulse_behind_its_probe_may_begin_with_what_the_probe_came_to(*, is_anodic: bool) -> None:
    probed = Visits()
    probed.message(node_v=HELD_V, is_anodic=is_anodic)
    allowed_v = HELD_V + probed.noise_v
    probed.message(allowed_v, HELD_V, pulses=0, is_anodic=is_anodic)
    said = probed.refused(allowed_v + LITTLE_V, pulses=0, is_anodic=is_anodic)
    assert f"at most {allowed_v:.1f} V" in said


def test_what_a_probe_came_to_is_the_higher_of_its_samples() -> None:
    for node_v, early_v in ((HELD_V, 1.0), (1.0, HELD_V)):
        probed = Visits()
        probed.message(node_v=node_v, early_v=early_v)
        probed.message(HELD_V, pulses=0)


def test_a_weak_probe_leaves_the_pulse_behind_it_what_has_rested() -> None:
    probed = Visits()
    probed.message(node_v=1.0)
    probed.message(RESTED_V, node_v=1.0, pulses=0)
    assert "at most 5.0 V" in probed.refused(RESTED_V + LITTLE_V, pulses=0)


@pytest.mark.parametrize("was_anodic", [True, False])
def test_the_next_visit_has_rested_whatever_the_one_before_came_to(*, was_anodic: bool) -> None:
    visits = Visits()
    visits.message(node_v=HELD_V, is_anodic=was_anodic)
    visits.message(RESTED_V, is_anodic=was_anodic)
    visits.message(node_v=HELD_V, is_anodic=was_anodic)
    assert "at most 5.0 V" in visits.refused(RESTED_V + LITTLE_V, is_anodic=was_anodic)


@pytest.mark.parametrize("first_anodic", [True, False])
def test_the_other_way_round_what_skin_holds_lowers_the_node(*, first_anodic: bool) -> None:
    visits = Visits()
    visits.message(node_v=HELD_V, is_anodic=first_anodic)
    said = visits.refused(RESTED_V + LITTLE_V, pulses=0, is_anodic=not first_anodic)
    assert "at most 5.0 V" in said


@pytest.mark.parametrize("is_early", [True, False])
@pytest.mark.parametrize("board", [CHAIN, RELAYS])
def test_in_a_pulse_no_sample_is_above_current_times_leak(board: str, *, is_early: bool) -> None:
    visits = Visits(board)

    def sample(baseline_v: float, node_v: float) -> None:
        pair = (0.0, node_v) if is_early else (node_v, 0.0)
        visits.message(baseline_v, *pair)

    for baseline_v in (0.0, 3.0):
        most_v = visits.most_v(baseline_v)
        sample(baseline_v, most_v)
        with pytest.raises(BoardFault, match="more current flows") as refusal:
            sample(baseline_v, most_v + LITTLE_V)
        assert f"uA at electrode {HERE}" in str(refusal.value)
        assert f"at most {most_v:.1f} V" in str(refusal.value)


def test_relays_close_over_charge_of_the_skin_and_it_is_not_judged() -> None:
    Visits(RELAYS).message(80.0)
