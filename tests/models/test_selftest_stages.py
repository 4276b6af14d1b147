"""The self-test as a whole: what passes, what is skipped, what is asked, and how it ends."""

from __future__ import annotations

import pytest

from etd.selftest.fixture import Fixture
from etd.selftest.report import Check, Report
from etd.selftest.run import STAGES, run
from etd_hal.bench import UNKNOWN_CORE, ScanCore
from etd_hal.boardfile import GUARDS
from etd_hal.fake.faults import (
    Bridge,
    Fault,
    LatchIgnored,
    LineCut,
    SlowWords,
    SpiError,
    SpiMode,
)
from selftest_rig import DATE, LOAD_OHM, bad, by_name, selftest_rig

BOARDS = ("reference-hv507", "kajimoto-hv507", "feetthrough-relay", "etactilekit-hv513")

WALK = ("every_switch", "one_at_a_time", "second_load", "every_switch_again")


def skipped(report: Report) -> list[str]:
    return [check.name for check in report.checks if check.result == "skip"]


@pytest.mark.parametrize("board", BOARDS)
def test_a_board_in_order_passes_with_two_loads_and_somebody_to_move_them(board: str) -> None:
    rig = selftest_rig(board)
    report = rig.run()
    assert bad(report) == []
    assert skipped(report) == []
    assert report.passed
    assert (report.subject.board, report.date, report.dummy_load_ohm) == (board, DATE, LOAD_OHM)


@pytest.mark.parametrize("load_ohm", [10_000, 22_000, 68_000])
def test_any_load_in_the_range_will_do(load_ohm: int) -> None:
    report = selftest_rig(load_ohm=load_ohm, second_ohm=33_000).run()
    assert (bad(report), report.passed) == ([], True)


def test_a_stack_is_walked_as_well() -> None:
    report = selftest_rig("etactilekit-hv513-x2", None).run()
    assert (bad(report), report.passed) == ([], True)
    assert by_name(report)["every_switch"].measured == "64 electrodes read 47000 ohm"
    assert by_name(report)["every_switch_again"].measured == "64 electrodes read 10000 ohm"


@pytest.mark.parametrize("board", BOARDS)
def test_it_breaks_no_rule_and_leaves_the_board_at_zero(board: str) -> None:
    rig = selftest_rig(board)
    rig.run()
    assert rig.fake.violations == []
    assert rig.fake.dac_code == 0
    if rig.loaded.board.guards.hv_enable != "absent":
        assert rig.rail_v_after_a_while() < 30


def test_stages_come_in_the_order_of_risk() -> None:
    stages = list(dict.fromkeys(check.stage for check in selftest_rig().run().checks))
    assert stages == [*(name for name, _ in STAGES), "end"]


@pytest.mark.parametrize("board", BOARDS)
def test_each_guard_has_a_check_that_proves_it_or_names_it_absent(board: str) -> None:
    rig = selftest_rig(board)
    checks = by_name(rig.run())
    absent = rig.loaded.board.absent_guards
    found = {name: checks[name].result for name in GUARDS}
    assert found == {name: "absent" if name in absent else "pass" for name in GUARDS}


@pytest.mark.parametrize(
    ("core", "most"),
    [
        (UNKNOWN_CORE, 80),
        (ScanCore(3, True, False, None), 80),
        (ScanCore(3, True, False, False), 98),
    ],
)
def test_what_the_scan_may_take_of_its_core_is_a_fact_and_no_condition(
    core: ScanCore, most: int
) -> None:
    rig = selftest_rig()
    rig.fake.world.host.modelled_core = core
    fact = by_name(rig.run())["scan_core"]
    assert fact.result == "pass"
    assert fact.measured.startswith(f"the scan takes at most {most} % of any 100 ms ({core}")


def test_without_a_load_what_needs_one_is_skipped_and_a_skip_is_no_pass() -> None:
    rig = selftest_rig(load_ohm=None)
    report = rig.run()
    assert bad(report) == []
    assert not report.passed
    assert skipped(report) == [
        "truth_table",
        "load_agrees",
        "leak",
        "ua_per_code",
        "blanked",
        "latch_holds",
        *WALK,
        "every_time",
        "steps",
        "linearity",
        "zero",
        "adc_bits",
        "compliance",
    ]
    assert rig.most_charge_nc == 0.0


def test_without_an_operator_stops_and_switches_are_skipped() -> None:
    report = selftest_rig(has_operator=False).run()
    assert bad(report) == []
    stops = ["emergency_stop", "wearer_stop", "emergency_stop_gate", "wearer_stop_gate"]
    assert skipped(report) == [*stops, "truth_table", *WALK]
    assert not report.passed


def test_a_one_shot_that_nobody_looked_at_is_a_skip_with_the_reason() -> None:
    report = selftest_rig(one_shot_us=None).run()
    assert skipped(report) == ["one_shot"]
    assert "no message that may be sent is as long" in by_name(report)["one_shot"].measured


def test_strong_pulses_go_only_into_a_load_that_was_found() -> None:
    with_load = selftest_rig()
    with_load.run()
    with_another = selftest_rig(really_ohm={LOAD_OHM: 60_000})
    report = with_another.run()
    assert with_load.most_charge_nc > 100
    assert bad(report)[0] == ("probe", "load_agrees")
    assert with_another.most_charge_nc <= report.bound.charge_nc


def test_with_somebody_on_the_array_beside_the_load_the_first_weak_pulse_is_the_last() -> None:
    rig = selftest_rig(on_skin=True)
    report = rig.run()
    assert bad(report) == [("array", "ramp")]
    assert rig.most_charge_nc < 1.0


def test_a_load_that_is_on_a_bridge_is_not_found_to_be_alone() -> None:
    report = selftest_rig(faults=[Bridge(1, 6)]).run()
    assert bad(report) == [("array", "nothing_else")]
    assert by_name(report)["nothing_else"].measured.startswith("1 differ: 6 (")


def test_the_board_is_safe_before_an_error_or_the_skips_after_a_failure_are_told() -> None:
    """A pipe that nobody reads holds the program up at whatever it prints."""
    for faults, name in (([SpiError(at_message=160)], "bus"), ([LineCut("HV")], "all")):
        rig = selftest_rig(faults=faults)
        fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
        is_on: dict[str, bool] = {}

        def on_check(
            check: Check, fixture: Fixture = fixture, is_on: dict[str, bool] = is_on
        ) -> None:
            is_on[check.name] = fixture.board.is_supply_on

        run(fixture, DATE, on_check=on_check)
        assert is_on["safe_state"] is is_on[name] is False
        assert is_on["rise" if name == "all" else "idle_node_live"]


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (LineCut("SYNC"), "a wire of SYNC"),
        (LineCut("TRIGGER"), "a wire of TRIGGER"),
        (SpiMode(0), "SPI mode 0 or 2"),
        (SpiMode(2), "SPI mode 0 or 2"),
    ],
)
def test_what_passes_though_it_is_wrong_is_in_the_list_of_what_is_not_seen(
    fault: Fault, said: str
) -> None:
    report = selftest_rig(faults=[fault], second_ohm=None).run()
    assert bad(report) == []
    assert any(said in sentence for sentence in report.not_seen)


def test_slower_words_within_the_machine_files_bounds_are_measured_and_planned_with() -> None:
    report = selftest_rig(faults=[SlowWords(4)], second_ohm=None).run()
    usual = selftest_rig(second_ohm=None, load_ohm=None).run()
    assert bad(report) == []
    word_us = [float(by_name(one)["one_word"].measured.split()[0]) for one in (report, usual)]
    assert word_us[0] - word_us[1] == pytest.approx(4.0, abs=0.1)


def test_relays_that_do_not_open_are_found_by_the_probe_that_must_reach_nobody() -> None:
    """From then on no word is copied: those of the load's end stay closed."""
    rig = selftest_rig("feetthrough-relay", second_ohm=None)
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)

    def on_check(check: Check) -> None:
        if check.name == "ua_per_code":
            rig.fake.world.put_in(LatchIgnored(every=1))

    report = run(fixture, DATE, on_check=on_check)
    assert bad(report)[0] == ("probe", "blanked")


def test_an_error_ends_in_the_safe_state_all_the_same() -> None:
    rig = selftest_rig()
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)

    def interrupt(name: str, _what: str) -> None:
        if name == "probe":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(fixture, DATE, on_stage=interrupt)
    assert not fixture.board.is_supply_on
    assert rig.rail_v_after_a_while() < 30


def test_an_interrupted_test_says_why_the_board_is_not_safe(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rig = selftest_rig()
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)

    def interrupt(name: str, _what: str) -> None:
        if name == "probe":
            for number in range(1, 20):
                rig.fake.world.put_in(SpiError(at_message=number))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(fixture, DATE, on_stage=interrupt)
    told = capsys.readouterr().err
    assert "NOT SAFE" in told
    assert "cut the supply by hand" in told
