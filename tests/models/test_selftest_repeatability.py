"""The rounds without hands: a latch that misses an edge now and then, whichever it begins with."""

from __future__ import annotations

import pytest

from etd.selftest.fixture import Fixture
from etd.selftest.report import Check
from etd.selftest.run import run
from etd_hal.fake.faults import LatchIgnored
from selftest_cases import BARE, RELAY
from selftest_rig import DATE, SelftestRig, bad, selftest_rig


def run_with(rig: SelftestRig, every: int, at_pulse: int) -> list[tuple[str, str]]:
    """What fails when the fault comes at such a pulse of the rounds, and not before them."""
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)

    def on_check(check: Check) -> None:
        if check.name == "load_still_there":
            rig.watch.before_pulse[rig.watch.pulses + at_pulse] = put_in

    def put_in() -> None:
        rig.fake.world.put_in(LatchIgnored(every=every))

    return bad(run(fixture, DATE, on_check=on_check))


@pytest.mark.parametrize("at_pulse", [60, 61, 62, 63])
@pytest.mark.parametrize(("board", "every"), [(RELAY, 100), (RELAY, 102), (BARE, 50), (BARE, 51)])
def test_a_latch_that_misses_one_edge_of_so_many_is_found(
    board: str, every: int, at_pulse: int
) -> None:
    """A selection is two edges of relays, and one of half-bridges; two make a pair."""
    rig = selftest_rig(board, second_ohm=None)
    assert run_with(rig, every, at_pulse)[:1] == [("source", "every_time")]
