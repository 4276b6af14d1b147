"""Strong pulses go only into a load that was found, and found again, and is alone."""

from __future__ import annotations

from typing import Any

import pytest

from etd.selftest import buses, probe, rail, switches, timing
from etd.selftest.bed import Bed
from etd.selftest.log import Log
from etd.selftest.prober import Prober
from etd_body.electrode import load
from etd_hal.errors import GuardRefusal
from etd_hal.fake.faults import Bridge, SwitchOutput
from selftest_rig import LOAD_OHM, SelftestRig, bad, selftest_rig


class Swapping:
    """Does what is asked; but with the hands off, something else has come to an electrode."""

    def __init__(self, rig: SelftestRig, touched: int, resistance_ohm: float) -> None:
        self._rig, self._hand = rig, rig.hand
        self._touched, self._resistance_ohm = touched, resistance_ohm

    def __getattr__(self, name: str) -> Any:
        return getattr(self._hand, name)

    def stand_back(self) -> None:
        self._rig.fake.world.touch(self._touched, load(self._resistance_ohm))


@pytest.mark.parametrize(
    ("touched", "resistance_ohm", "name"),
    [(1, 40_000.0, "load_still_there"), (7, 300_000.0, "still_alone")],
)
def test_what_comes_to_the_array_before_the_strong_pulses_gets_none_of_them(
    touched: int, resistance_ohm: float, name: str
) -> None:
    """A finger of 300 k beside a load of 47 k changes what the load reads by too little."""
    rig = selftest_rig()
    rig.hand = Swapping(rig, touched, resistance_ohm)
    report = rig.run()
    assert bad(report) == [("source", name)]
    assert "steps" not in [check.name for check in report.checks]
    assert rig.most_charge_nc <= report.bound.charge_nc


def bed_after_rail(rig: SelftestRig, log: Log) -> tuple[Bed, Prober]:
    """A bed as the probes find it: timed, the supply on."""
    bed = Bed(rig.loaded, rig.bench, rig.hand, rig.asked)
    prober = Prober(bed)
    buses.check(bed, log)
    timing.check(bed, log)
    rail.check(bed, log, prober)
    return bed, prober


def test_nothing_strong_is_fired_before_the_load_was_found() -> None:
    rig = selftest_rig()
    bed, prober = bed_after_rail(rig, Log())
    with pytest.raises(GuardRefusal, match="no load was found"):
        prober.into_load(1, 301)
    assert rig.most_charge_nc == 0.0
    bed.board.safe_off()


@pytest.mark.parametrize(
    ("real_load_ohm", "is_confirmed"), [(47_000.0, True), (44_000.0, True), (60_000.0, False)]
)
def test_a_load_is_confirmed_by_its_resistance(real_load_ohm: float, is_confirmed: bool) -> None:
    rig, log = selftest_rig(really_ohm={LOAD_OHM: real_load_ohm}), Log()
    bed, prober = bed_after_rail(rig, log)
    log.stage = "probe"
    probe.check(bed, log, prober)
    assert bed.is_load_confirmed is is_confirmed
    bed.board.safe_off()


def test_a_walk_that_did_not_find_every_switch_leaves_no_confirmed_load() -> None:
    rig, log = selftest_rig(faults=[SwitchOutput(9, "open")]), Log()
    bed, prober = bed_after_rail(rig, log)
    log.stage = "probe"
    probe.check(bed, log, prober)
    assert bed.is_load_confirmed
    log.stage = "switches"
    switches.check(bed, log, prober)
    assert not bed.is_load_confirmed
    bed.board.safe_off()


class LeftOff:
    """Does what is asked, but for the last time: no load comes back, or solder with it."""

    def __init__(self, rig: SelftestRig, how: str) -> None:
        self._rig, self._hand, self._how = rig, rig.hand, how
        self._has_second = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._hand, name)

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        assert self._hand is not None
        self._hand.clip(load_ohm, first, second)
        self._has_second |= load_ohm != LOAD_OHM
        if self._has_second and load_ohm == LOAD_OHM:
            if self._how == "load_back":
                self._rig.fake.world.lift(second)
            else:
                self._rig.fake.world.put_in(Bridge(5, 6))


@pytest.mark.parametrize("how", ["load_back", "nothing_else"])
def test_a_load_that_did_not_come_back_alone_is_not_confirmed(how: str) -> None:
    rig, log = selftest_rig(), Log()
    rig.hand = LeftOff(rig, how)
    bed, prober = bed_after_rail(rig, log)
    log.stage = "probe"
    probe.check(bed, log, prober)
    log.stage = "switches"
    switches.check(bed, log, prober)
    assert log.names("fail") == [("switches", how)]
    assert not bed.is_load_confirmed
    bed.board.safe_off()
