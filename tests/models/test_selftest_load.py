"""Strong pulses go only into a load that was found, and found again, and is alone."""

from __future__ import annotations

from typing import Any

import pytest

from etd.selftest import array, buses, probe, rail, switches, timing
from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd_body.electrode import load
from etd_hal.errors import GuardRefusal
from etd_hal.fake.faults import Bridge, SwitchOutput
from selftest_rig import LOAD_OHM, SelftestRig, bad, selftest_rig


class Swapping:
    """Does what is asked; but with the hands off, something else has come to an electrode."""

    def __init__(self, rig: SelftestRig, touched: int, resistance_ohm: float) -> None:
        self._rig, self._hand = rig, rig.operator
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
    rig.operator = Swapping(rig, touched, resistance_ohm)
    report = rig.run()
    assert bad(report) == [("source", name)]
    assert "steps" not in [check.name for check in report.checks]
    assert rig.most_charge_nc <= report.bound.charge_nc


def bed_after_rail(rig: SelftestRig, log: CheckLog) -> tuple[Fixture, Prober]:
    """A bed as the probes find it: timed, the supply on."""
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
    prober = Prober(fixture)
    buses.check(fixture, log)
    timing.check(fixture, log)
    rail.check(fixture, log, prober)
    return fixture, prober


def find_load(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    for stage in (array, probe):
        log.stage = stage.__name__.rpartition(".")[2]
        stage.check(fixture, log, prober)


def test_nothing_strong_is_fired_before_the_load_was_found() -> None:
    rig = selftest_rig()
    fixture, prober = bed_after_rail(rig, CheckLog())
    with pytest.raises(GuardRefusal, match="the load is not confirmed"):
        prober.into_load(1, 301)
    assert rig.most_charge_nc == 0.0
    fixture.board.safe_off()


@pytest.mark.parametrize(
    ("real_load_ohm", "is_confirmed"), [(47_000.0, True), (44_000.0, True), (60_000.0, False)]
)
def test_a_load_is_confirmed_by_its_resistance(real_load_ohm: float, is_confirmed: bool) -> None:
    rig, log = selftest_rig(really_ohm={LOAD_OHM: real_load_ohm}), CheckLog()
    fixture, prober = bed_after_rail(rig, log)
    find_load(fixture, log, prober)
    assert fixture.is_load_confirmed is is_confirmed
    fixture.board.safe_off()


def test_a_walk_that_did_not_find_every_switch_leaves_no_confirmed_load() -> None:
    rig, log = selftest_rig(faults=[SwitchOutput(9, "open")]), CheckLog()
    fixture, prober = bed_after_rail(rig, log)
    find_load(fixture, log, prober)
    assert fixture.is_load_confirmed
    log.stage = "switches"
    switches.check(fixture, log, prober)
    assert not fixture.is_load_confirmed
    fixture.board.safe_off()


class LeftOff:
    """Does what is asked, but for the last time: no load comes back, or solder with it."""

    def __init__(self, rig: SelftestRig, how: str) -> None:
        self._rig, self._hand, self._how = rig, rig.operator, how
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
    rig, log = selftest_rig(), CheckLog()
    rig.operator = LeftOff(rig, how)
    fixture, prober = bed_after_rail(rig, log)
    find_load(fixture, log, prober)
    log.stage = "switches"
    switches.check(fixture, log, prober)
    assert log.names("fail") == [("switches", how)]
    assert not fixture.is_load_confirmed
    fixture.board.safe_off()
