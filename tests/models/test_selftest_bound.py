"""No pulse exceeds the stated bound of a probe, by the body's own account.

That is so for all faults of the list, among them a source up to 24 times too strong from the first
pulse on; one that is stronger gives one pulse.
"""

from __future__ import annotations

from typing import Any

import pytest

from etd_body.electrode import load
from etd_hal.fake.faults import (
    DacGain,
    Fault,
    GainAbove,
    LineInverted,
    Overshoot,
    StuckBehind,
)
from selftest_cases import ALL, BARE, CASES, RELAY, Case, case_id, rig_of
from selftest_rig import LOAD_OHM, SelftestRig, bad, selftest_rig

#: With BL 1 the outputs stay blanked, and without a load nothing else is commanded.
NEVER_ON = (StuckBehind("BL", 0), LineInverted("BL"))
#: Pulses are fired, and none of them can reach an electrode.
NOTHING_FLOWS = {
    "the rail does not come, relays",
    "a stuck DAC before relays",
    "no rail, nobody sees it",
    "BL is cut",
    *(f"{fault}, {board}" for board in (ALL, BARE) for fault in NEVER_ON),
    "DATA is cut, nobody reads back",
    "nothing is copied, relays",
}


def check_bound(rig: SelftestRig, case: Case, was_fired: bool) -> None:
    """At most the bound; and something, where something was fired at skin."""
    report = rig.run()
    assert report.bound.charge_nc == 15.0
    assert not report.passed
    assert rig.most_charge_nc <= report.bound.charge_nc
    is_felt = was_fired and rig.watch.pulses > 0 and case.what not in NOTHING_FLOWS
    assert (rig.most_charge_nc > 0.0) is is_felt


@pytest.mark.parametrize("case", CASES, ids=case_id)
def test_with_a_finger_on_the_array_no_pulse_exceeds_the_bound_with_any_fault_of_the_list(
    case: Case,
) -> None:
    check_bound(rig_of(case, load_ohm=None, on_skin=True), case, was_fired=True)


@pytest.mark.parametrize("case", CASES, ids=case_id)
def test_nor_when_the_finger_comes_at_any_pulse_later(case: Case) -> None:
    """The ramp has four: from the fifth on the probes of the map are on their way, say."""
    alone = rig_of(case, load_ohm=None)
    alone.run()
    last = alone.watch.pulses
    for at_pulse in sorted({1, 4, 5, last // 2, last} & set(range(1, last + 1))):
        rig = rig_of(case, load_ohm=None)
        rig.watch.before_pulse = {at_pulse: rig.lay_finger_on}
        check_bound(rig, case, was_fired=True)


@pytest.mark.parametrize("board", [ALL, BARE, RELAY])
@pytest.mark.parametrize("factor", [1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("at_pulse", [5, 12, 20])
def test_a_source_that_becomes_too_strong_under_a_finger_stays_within_the_bound(
    board: str, factor: float, at_pulse: int
) -> None:
    rig = selftest_rig(board, load_ohm=None)

    def happens() -> None:
        rig.lay_finger_on()
        rig.fake.world.put_in(DacGain(factor))

    rig.watch.before_pulse = {at_pulse: happens}
    report = rig.run()
    assert not report.passed
    assert 0 < rig.most_charge_nc <= report.bound.charge_nc


@pytest.mark.parametrize("board", [ALL, BARE])
@pytest.mark.parametrize("factor", [3.0, 5.0, 24.0])
@pytest.mark.parametrize("is_touched", [False, True])
def test_a_source_that_becomes_too_strong_after_the_ramp_has_fired_its_last_pulse(
    board: str, factor: float, is_touched: bool
) -> None:
    rig = selftest_rig(board, load_ohm=None)

    def happens() -> None:
        if is_touched:
            rig.lay_finger_on()
        rig.fake.world.put_in(DacGain(factor))

    rig.watch.before_pulse = {9: happens}
    assert bad(rig.run()) == [("array", "strength_of_a_probe")]
    assert rig.watch.pulses == 9


@pytest.mark.parametrize("board", [ALL, BARE, RELAY])
@pytest.mark.parametrize("asked", [5, 12])
def test_a_finger_that_comes_while_every_electrode_is_touched_gets_probes_only(
    board: str, asked: int
) -> None:
    rig = selftest_rig(board)
    rig.operator = _Clumsy(rig, asked)
    report = rig.run()
    assert bad(report)[0][0] == "switches"
    assert 0 < rig.most_charge_nc <= report.bound.charge_nc


class _Clumsy:
    """Does what is asked; at one of the touches, the finger of somebody else comes down, too."""

    def __init__(self, rig: SelftestRig, asked: int) -> None:
        self._rig, self._hand, self._asked = rig, rig.operator, asked

    def __getattr__(self, name: str) -> Any:
        return getattr(self._hand, name)

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        assert self._hand is not None
        self._hand.clip(load_ohm, first, second)
        if second == self._asked:
            self._rig.lay_finger_on()


@pytest.mark.parametrize("board", [ALL, BARE])
@pytest.mark.parametrize("factor", [1.5, 2.0, 2.3, 3.0])
@pytest.mark.parametrize("skin_ohm", [20_000, 60_000, 200_000])
def test_a_load_that_is_named_but_not_there_raises_nothing_above_the_bound_on_skin(
    board: str, factor: float, skin_ohm: int
) -> None:
    """Current that is too strong through skin that conducts may look like nothing connected."""
    rig = selftest_rig(board, faults=[DacGain(factor)], load_ohm=LOAD_OHM)
    for electrode in range(rig.loaded.array.count):
        rig.fake.world.touch(electrode, load(float(skin_ohm)))
    report = rig.run()
    assert not report.passed
    assert rig.most_charge_nc <= report.bound.charge_nc


@pytest.mark.parametrize("board", [ALL, BARE, RELAY])
@pytest.mark.parametrize("factor", [1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 10.0, 24.0])
def test_a_source_that_is_too_strong_by_any_factor_stays_within_the_bound_on_skin(
    board: str, factor: float
) -> None:
    rig = selftest_rig(board, faults=[DacGain(factor)], load_ohm=None, on_skin=True)
    report = rig.run()
    assert 0 < rig.most_charge_nc <= report.bound.charge_nc


@pytest.mark.parametrize("board", [ALL, BARE, RELAY])
@pytest.mark.parametrize("factor", [2.0, 3.0, 5.0, 8.0, 10.0, 24.0])
@pytest.mark.parametrize("until_us", [12.0, 20.0, 36.0])
def test_a_source_that_is_too_strong_at_first_stays_within_the_bound_on_skin(
    board: str, factor: float, until_us: float
) -> None:
    faults = [Overshoot(factor, until_us)]
    rig = selftest_rig(board, faults=faults, load_ohm=None, on_skin=True)
    assert not rig.run().passed
    assert 0 < rig.most_charge_nc <= 15.0


@pytest.mark.parametrize("board", [ALL, BARE, RELAY])
@pytest.mark.parametrize("fault", [DacGain(100.0), GainAbove(6, 24.0)])
def test_one_that_is_stronger_or_jumps_within_the_ramp_gives_one_pulse_above_it(
    board: str, fault: Fault
) -> None:
    """No program can know of it before: that is said in the report."""
    rig = selftest_rig(board, faults=[fault], load_ohm=None, on_skin=True)
    was_above: list[bool] = []
    rig.watch.before_pulse = dict.fromkeys(range(1, 30), lambda: was_above.append(is_above(rig)))
    report = rig.run()
    assert is_above(rig)
    assert was_above
    assert not any(was_above)
    assert any("that pulse exceeds the bound" in text for text in report.not_seen)


def is_above(rig: SelftestRig) -> bool:
    return rig.most_charge_nc > 15.0
