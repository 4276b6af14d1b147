"""A test that is broken off at any point, also in the middle of a call, ends in the safe state."""

from __future__ import annotations

from typing import Any

import pytest

from etd.selftest.fixture import Fixture
from etd.selftest.prober import Prober
from etd.selftest.run import run
from etd_body.minimal import MinimalBody
from etd_hal.fake.currentpath import CurrentPath
from etd_hal.fake.halfbridges import HalfBridgeChain
from etd_hal.fake.rail import Rail
from etd_hal.fake.relays import RelayChain
from etd_hal.fake.timeline import Timeline
from selftest_cases import ALL, BARE, RELAY
from selftest_rig import DATE, ChangedUnderstudy, SelftestRig, selftest_rig

#: What a call goes through; a signal may come behind each of them.
PLACES = [
    (MinimalBody, "_advance"),
    (CurrentPath, "_follow_rail"),
    (CurrentPath, "_drive"),
    (HalfBridgeChain, "set"),
    (RelayChain, "_move"),
    (Rail, "enable"),
    (Timeline, "end"),
]
PLACE_IDS = [f"{cls.__name__}.{name.strip('_')}" for cls, name in PLACES]


class Interruption:
    """Ctrl-C comes as the n-th of these calls ends, once."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, place: tuple[type, str]) -> None:
        self.calls = 0
        self.at_call: int | None = None
        really = getattr(*place)

        def called(*args: Any, **how: Any) -> Any:
            answer = really(*args, **how)
            self.calls += 1
            if self.calls == self.at_call:
                raise KeyboardInterrupt
            return answer

        monkeypatch.setattr(*place, called)

    def begin(self, at_call: int | None) -> None:
        self.calls, self.at_call = 0, at_call


def probe_once(rig: SelftestRig) -> Fixture:
    """The supply on, the ramp at one electrode."""
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
    fixture.board.calibrate()
    fixture.supply_on()
    Prober(fixture).ramp(5)
    return fixture


def is_at_rest(rig: SelftestRig) -> bool:
    now_ns = rig.clock.now_ns()
    return rig.fake.dac_code == 0 and rig.body.node_voltage_v(now_ns) == 0.0


@pytest.mark.parametrize("board", [ALL, RELAY])
@pytest.mark.parametrize("place", PLACES, ids=PLACE_IDS)
def test_broken_off_in_any_call_of_a_pulse_the_board_is_made_safe(
    monkeypatch: pytest.MonkeyPatch, place: tuple[type, str], board: str
) -> None:
    interruption = Interruption(monkeypatch, place)
    whole = selftest_rig(board)
    interruption.begin(None)
    probe_once(whole)
    for at_call in range(1, interruption.calls + 1):
        rig = selftest_rig(board)
        interruption.begin(at_call)
        with pytest.raises(KeyboardInterrupt):
            probe_once(rig)
        board_of_rig = Fixture(rig.loaded, rig.bench, rig.operator, rig.options).board
        assert board_of_rig.safe_off() == (), at_call
        assert is_at_rest(rig), at_call


@pytest.mark.parametrize("board", [ALL, BARE, RELAY])
@pytest.mark.parametrize("place", [PLACES[0], PLACES[-1]], ids=[PLACE_IDS[0], PLACE_IDS[-1]])
def test_broken_off_anywhere_in_a_test_it_says_that_the_board_is_safe(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    place: tuple[type, str],
    board: str,
) -> None:
    interruption = Interruption(monkeypatch, place)
    whole = selftest_rig(board)
    interruption.begin(None)
    whole.run()
    last = interruption.calls
    for at_call in [*range(1, last, last // 3), last - 3]:
        rig = selftest_rig(board)
        fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
        interruption.begin(at_call)
        with pytest.raises(KeyboardInterrupt):
            run(fixture, DATE)
        told = capsys.readouterr().err
        assert told == "etd selftest: interrupted; the board is in its safe state\n", at_call
        assert is_at_rest(rig)
        assert board == BARE or rig.rail_v_after_a_while() < 30


def test_broken_off_while_the_lines_are_taken_back_they_are_taken_back_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tries: list[None] = []

    class BrokenOffOnce(ChangedUnderstudy):
        def step_back(self) -> None:
            tries.append(None)
            if len(tries) == 1:
                raise KeyboardInterrupt
            super().step_back()

    rig = selftest_rig()
    rig.let_another_be_killed(BrokenOffOnce)
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
    with pytest.raises(KeyboardInterrupt):
        run(fixture, DATE)
    assert len(tries) == 2
    assert not rig.is_understudy_alive
    assert "the board is in its safe state" in capsys.readouterr().err
    assert rig.rail_v_after_a_while() < 30
