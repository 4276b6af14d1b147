"""Stage 10 climbs a ladder, and stops at the first step that is off."""

from __future__ import annotations

import pytest

from etd.files.configuration import fake_config
from etd.selftest.ladder import largest_ohm
from etd.selftest.subject import strongest_ua
from etd_hal.fake.faults import Fault, GainAbove, Saturation
from selftest_rig import ARRAY, bad, selftest_rig
from stepped_board import shipped_board

#: Half a milliampere a step, up to what the body site allows.
STEP_UA, MOST_UA = 500, 8_000


def code_of(current_ua: int) -> int:
    return shipped_board("kajimoto-hv507").source.code_for(current_ua)


@pytest.mark.parametrize(
    ("fault", "name", "step"),
    [
        (GainAbove(60, 1.5), "steps", 1),
        (GainAbove(60, 0.5), "steps", 1),
        (GainAbove(code_of(2_000), 2.0), "steps", 5),
        (GainAbove(code_of(2_000), 1.3), "steps", 5),
        (GainAbove(code_of(7_500), 1.3), "steps", 16),
        (GainAbove(code_of(2_000), 0.5), "linearity", 5),
        (Saturation(4_000.0), "linearity", 10),
        (Saturation(450.0), "linearity", 2),
    ],
)
def test_a_source_that_is_wrong_never_comes_to_its_strongest(
    fault: Fault, name: str, step: int
) -> None:
    """By what was on the wire; a few per cent more than it should make is nobody's fault."""
    rig = selftest_rig(faults=[fault])
    report = rig.run()
    assert bad(report) == [("source", name)]
    assert rig.watch.most_code == code_of(step * STEP_UA)
    said = next(check.measured for check in report.checks if check.result == "fail")
    assert f"at step {step} of 16; nothing stronger was fired" in said


def test_a_source_in_order_is_climbed_to_the_top() -> None:
    rig = selftest_rig()
    assert rig.run().passed
    assert rig.watch.most_code == code_of(MOST_UA)


@pytest.mark.parametrize("fault", [(), (GainAbove(2_600, 2.0),), (Saturation(6_500.0),)])
def test_a_load_that_keeps_the_top_out_of_reach_is_no_pass(fault: tuple[Fault, ...]) -> None:
    """With 100 k the ladder ended at 6 mA, and nothing above that was looked at."""
    rig = selftest_rig(load_ohm=100_000, second_ohm=33_000, faults=fault)
    report = rig.run()
    assert bad(report) == [("source", "steps")]
    assert rig.most_charge_nc <= report.bound.charge_nc


@pytest.mark.parametrize(
    "board", ["reference-hv507", "kajimoto-hv507", "feetthrough-relay", "etactilekit-hv513"]
)
@pytest.mark.parametrize("leak_factor", [0.97, 1.0])
def test_the_largest_load_that_is_taken_can_be_climbed_to_the_top(
    board: str, leak_factor: float
) -> None:
    """And where the leak is a little smaller than the board file says."""
    loaded = fake_config(board, ARRAY)
    most_ohm = largest_ohm(loaded.board.source, strongest_ua(loaded))
    assert most_ohm is not None
    rig = selftest_rig(board, load_ohm=most_ohm, leak_factor=leak_factor)
    assert bad(rig.run()) == []
    assert largest_ohm(loaded.board.source, 1_000) is None


def test_a_source_that_is_a_little_off_is_climbed_and_then_judged_as_a_line() -> None:
    """Off by less than a step may be, and by more than the line may be."""
    rig = selftest_rig(faults=[Saturation(7_000.0)])
    assert ("source", "linearity") in bad(rig.run())
    assert rig.watch.most_code == code_of(MOST_UA)
