"""The ordinary noise of an ADC is no fault: a good board passes with it, a bad one does not."""

from __future__ import annotations

import pytest

from etd_hal.fake.faults import AdcNoise, Fault, LatchIgnored, OutputSeries
from selftest_rig import LOAD_OHM, SECOND_OHM, bad, selftest_rig

BOARDS = ("reference-hv507", "kajimoto-hv507", "feetthrough-relay")
#: Several times what a twelve-bit ADC of this kind has by itself.
CODES = 1.5


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("board", BOARDS)
def test_a_board_in_order_passes_with_a_noise_of_one_code_and_a_half(board: str, seed: int) -> None:
    report = selftest_rig(board, faults=[AdcNoise(CODES, seed)]).run()
    assert (bad(report), report.passed) == ([], True)


@pytest.mark.parametrize(("load_ohm", "second_ohm"), [(SECOND_OHM, LOAD_OHM), (68_000, 22_000)])
def test_it_does_so_with_other_loads(load_ohm: int, second_ohm: int) -> None:
    """Ten codes are what the smallest load reads at a probe."""
    rig = selftest_rig(load_ohm=load_ohm, second_ohm=second_ohm, faults=[AdcNoise(CODES)])
    assert bad(rig.run()) == []


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (LatchIgnored(every=199), "every_time"),
        (OutputSeries(9, 15_000), "every_switch"),
        (OutputSeries(9, 5_000), "every_switch_again"),
    ],
)
@pytest.mark.parametrize("seed", range(2))
def test_what_is_wrong_with_switches_is_seen_beneath_it(fault: Fault, name: str, seed: int) -> None:
    report = selftest_rig(faults=[fault, AdcNoise(CODES, seed)]).run()
    # Noise may leave it to the walk on the second load.
    assert [check for _, check in bad(report)] in ([name], [f"{name}_again"])


def test_a_noise_that_no_adc_has_is_no_pass() -> None:
    assert not selftest_rig(faults=[AdcNoise(12.0)]).run().passed
