"""The self-test as a whole: what passes, what is skipped, what is asked, and how it ends."""

from __future__ import annotations

from typing import Any, Literal

import msgspec
import pytest

from board_rig import changed
from etd.config import fake_config
from etd.selftest.bed import Bed
from etd.selftest.run import STAGES, run
from etd.selftest_report import Check, Report
from etd_hal.boardfile import GUARDS, BoardFile, Heartbeat
from etd_hal.fake.faults import (
    Bridge,
    DacGain,
    Fault,
    HeartbeatByLevel,
    HeartbeatIgnored,
    HeartbeatRearms,
    I2cFailure,
    LatchIgnored,
    LineCut,
    RailOff,
    SlowWords,
    SpiError,
    SpiMode,
    StopCutsNothing,
    StuckBehind,
)
from etd_hal.fake.hand import FakeHand
from etd_hal.fake.understudy import FakeUnderstudy
from selftest_rig import DATE, LOAD_OHM, LazyHand, bad, selftest_rig
from stepped_board import shipped_board

BOARDS = ("reference-hv507", "kajimoto-hv507", "feetthrough-relay", "etactilekit-hv513")

WALK = ("every_switch", "one_at_a_time", "second_load", "every_switch_again")


def by_name(report: Report) -> dict[str, Check]:
    """The last check of each name."""
    return {check.name: check for check in report.checks}


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


@pytest.mark.parametrize(
    ("faults", "failed"),
    [
        ([], []),
        ([HeartbeatIgnored()], [("rail", "heartbeat")]),
        ([HeartbeatByLevel(0)], [("rail", "heartbeat")]),
        ([HeartbeatByLevel(1)], [("rail", "heartbeat")]),
        ([HeartbeatRearms()], [("rail", "heartbeat_latch")]),
    ],
)
def test_a_heartbeat_is_proved_by_the_node_where_nobody_watches_the_rail(
    faults: list[Fault], failed: list[tuple[str, str]]
) -> None:
    beating = Heartbeat(line=27, window_ms=20)
    file = changed(shipped_board("feetthrough-relay"), "guards", heartbeat=beating)
    report = selftest_rig("feetthrough-relay", file=file, faults=faults).run()
    assert bad(report) == failed
    assert report.passed is not bool(failed)


@pytest.mark.parametrize("board", ["reference-hv507", "feetthrough-relay"])
@pytest.mark.parametrize("level", [0, 1])
def test_the_level_that_holds_a_gate_on_is_told(board: str, level: Literal[0, 1]) -> None:
    file = shipped_board(board)
    file = changed(file, "guards", heartbeat=Heartbeat(line=27, window_ms=20))
    report = selftest_rig(board, file=file, faults=[HeartbeatByLevel(level)]).run()
    found = [check for check in report.checks if check.result == "fail"]
    assert [check.name for check in found] == ["heartbeat"]
    assert found[0].measured.endswith(f"the line standing at {level}")


@pytest.mark.parametrize("load_ohm", [10_000, 22_000, 68_000])
def test_any_load_in_the_range_will_do(load_ohm: int) -> None:
    report = selftest_rig(load_ohm=load_ohm, second_ohm=33_000).run()
    assert (bad(report), report.passed) == ([], True)


def test_a_stack_is_walked_as_well() -> None:
    report = selftest_rig("etactilekit-hv513-x2", None).run()
    assert (bad(report), report.passed) == ([], True)
    assert by_name(report)["every_switch"].measured == "64 electrodes found on 47000 ohm"
    assert by_name(report)["every_switch_again"].measured == "64 electrodes found on 10000 ohm"


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


def test_without_a_load_what_needs_one_is_skipped_and_a_skip_is_no_pass() -> None:
    rig = selftest_rig(load_ohm=None)
    report = rig.run()
    assert bad(report) == []
    assert not report.passed
    assert skipped(report) == [
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
    assert skipped(report) == [*stops, *WALK]
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
    assert bad(report) == [("probe", "ramp")]
    assert rig.most_charge_nc < 1.0


def test_a_load_that_is_on_a_bridge_is_not_found_to_be_alone() -> None:
    report = selftest_rig(faults=[Bridge(1, 6)]).run()
    assert bad(report) == [("probe", "nothing_else")]
    assert by_name(report)["nothing_else"].measured.startswith("1 differ: 6 (")


def gates(report: Report) -> list[tuple[str, str]]:
    return [
        (check.name, check.result)
        for check in report.checks
        if check.name.endswith(("stop_gate", "stop_off"))
    ]


def with_stops(board: str, cuts: bool) -> BoardFile:
    """A board that has both stops, with a second contact or without."""
    file = fake_config(board).board
    guards = msgspec.structs.replace(
        file.guards, emergency_stop=17, wearer_stop=16, stop_cuts_supply=cuts
    )
    return msgspec.structs.replace(file, guards=guards)


@pytest.mark.parametrize("board", BOARDS)
def test_a_stop_that_is_held_is_seen_to_take_the_supply_away(board: str) -> None:
    """By the monitor, or by the node where nobody watches the rail."""
    report = selftest_rig(board, file=with_stops(board, cuts=True)).run()
    assert bad(report) == []
    assert gates(report) == [("emergency_stop_gate", "pass"), ("wearer_stop_gate", "pass")]


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("stop", ["emergency_stop", "wearer_stop"])
def test_a_stop_that_cuts_nothing_is_named_on_every_board(board: str, stop: Any) -> None:
    rig = selftest_rig(board, file=with_stops(board, cuts=True), faults=[StopCutsNothing(stop)])
    assert bad(rig.run())[:1] == [("rail", f"{stop}_gate")]


def test_a_supply_that_outlives_the_program_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever was killed goes on beating: as a gate that takes something else for a beat."""
    rig = selftest_rig()
    monkeypatch.setattr(FakeUnderstudy, "kill", lambda _: 3.0)
    failed = [name for _, name in bad(rig.run())]
    assert failed == ["killed_lines", "killed_supply"]


@pytest.mark.parametrize(("has_heartbeat", "failed"), [(True, []), (False, ["killed_lines"])])
def test_lines_that_are_let_go_of_late_are_the_heartbeats_business_if_there_is_one(
    monkeypatch: pytest.MonkeyPatch, has_heartbeat: bool, failed: list[str]
) -> None:
    kill = FakeUnderstudy.kill
    monkeypatch.setattr(FakeUnderstudy, "kill", lambda one: kill(one) + 40.0)
    file = fake_config("reference-hv507").board
    if not has_heartbeat:
        file = msgspec.structs.replace(
            file, guards=msgspec.structs.replace(file.guards, heartbeat="absent")
        )
    assert [name for _, name in bad(selftest_rig(file=file).run())] == failed


def test_a_process_that_cannot_bring_the_rail_up_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeUnderstudy, "_beat", lambda _: None)
    assert bad(selftest_rig().run()) == [("rail", "killed_rise")]


def test_an_error_while_another_process_has_the_board_ends_with_the_lines_taken_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = selftest_rig()

    def kill(_: FakeUnderstudy) -> float:
        rig.fake.world.put_in(I2cFailure(0x48, "io"))
        return 3.0

    monkeypatch.setattr(FakeUnderstudy, "kill", kill)
    assert bad(rig.run()) == [("rail", "bus")]
    assert isinstance(rig.bench.understudy, FakeUnderstudy)
    assert not rig.bench.understudy.is_alive
    assert rig.rail_v_after_a_while() < 30.0


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("factor", [3.0, 5.0, 24.0])
def test_looking_at_a_stop_by_the_node_keeps_within_the_bound_on_skin(
    board: str, factor: float
) -> None:
    rig = selftest_rig(
        board, file=with_stops(board, cuts=True), faults=[DacGain(factor)], on_skin=True
    )
    report = rig.run()
    assert not report.passed
    assert rig.most_charge_nc <= report.bound.charge_nc


def test_where_the_file_says_that_stops_cut_nothing_the_program_is_seen_to_do_it() -> None:
    report = selftest_rig(file=with_stops("reference-hv507", cuts=False)).run()
    assert bad(report) == []
    assert gates(report) == [
        ("emergency_stop_gate", "absent"),
        ("emergency_stop_off", "pass"),
        ("wearer_stop_gate", "absent"),
        ("wearer_stop_off", "pass"),
    ]


def test_a_stop_that_is_let_go_of_too_early_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = selftest_rig()
    monkeypatch.setattr(FakeHand, "hold", FakeHand.press)
    found = [check for check in rig.run().checks if check.result == "fail"]
    assert [check.name for check in found] == ["emergency_stop_gate"]
    assert found[0].measured.startswith("closed again after ")


def test_a_stop_that_stays_open_after_it_was_held_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = selftest_rig()
    monkeypatch.setattr(FakeHand, "let_go", LazyHand.let_go)
    assert bad(rig.run()) == [("rail", "emergency_stop")]


def test_an_emergency_stop_during_the_test_ends_it() -> None:
    rig = selftest_rig()
    rig.clock.at(rig.clock.now_ns() + 7_000_000_000, lambda: rig.fake.world.press("emergency_stop"))
    report = rig.run()
    assert [name for _, name in bad(report)] == ["emergency_stop"]
    assert rig.fake.dac_code == 0


def test_a_stop_that_is_pressed_in_a_wait_ends_the_supply_at_once() -> None:
    """In the five seconds of hands off; by a line that cuts nothing by itself."""
    cuts_nothing = StopCutsNothing("emergency_stop")
    rig = selftest_rig(file=with_stops("reference-hv507", cuts=False), faults=[cuts_nothing])
    pressed_ns: list[int] = []

    class Pressing(FakeHand):
        def stand_back(self) -> None:
            pressed_ns.append(rig.clock.now_ns() + 1_000_000_000)
            rig.fake.world.press("emergency_stop", pressed_ns[0])

    rig.hand = Pressing(rig.fake.world, rig.clock)
    rig.hand.clip(LOAD_OHM, 1, 2)
    assert bad(rig.run())[:1] == [("source", "emergency_stop")]
    assert 0 < rig.clock.now_ns() - pressed_ns[0] < 20_000_000


def test_the_board_is_safe_before_an_error_or_the_skips_after_a_failure_are_told() -> None:
    """A pipe that nobody reads holds the program up at whatever it prints."""
    for faults, name in (([SpiError(at_message=160)], "bus"), ([LineCut("HV")], "all")):
        rig = selftest_rig(faults=faults)
        bed = Bed(rig.loaded, rig.bench, rig.hand, rig.asked)
        is_on: dict[str, bool] = {}

        def on_check(check: Check, bed: Bed = bed, is_on: dict[str, bool] = is_on) -> None:
            is_on[check.name] = bed.board.is_supply_on

        run(bed, DATE, on_check=on_check)
        assert is_on["safe_state"] is is_on[name] is False
        assert is_on["rise" if name == "all" else "idle_node_live"]


def test_a_rail_that_sags_before_the_heartbeat_ends_proves_no_gate() -> None:
    rig = selftest_rig()
    bed = Bed(rig.loaded, rig.bench, rig.hand, rig.asked)

    def on_check(check: Check) -> None:
        if check.name == "rise_again":
            rig.fake.world.put_in(RailOff(0.9))
            bed.wait_ms(3_000)

    report = run(bed, DATE, on_check=on_check)
    assert bad(report)[:1] == [("rail", "heartbeat")]
    assert by_name(report)["heartbeat"].measured.startswith("from 271 V, below 30.0 V")


@pytest.mark.parametrize(("has_heartbeat", "is_said"), [(True, True), (False, False)])
def test_a_window_that_nobody_can_measure_is_said_in_the_report(
    has_heartbeat: bool, is_said: bool
) -> None:
    beating = Heartbeat(line=27, window_ms=20) if has_heartbeat else "absent"
    file = changed(shipped_board("feetthrough-relay"), "guards", heartbeat=beating)
    report = selftest_rig("feetthrough-relay", file=file, load_ohm=None).run()
    assert any("window is 20 ms" in one for one in report.not_seen) is is_said


def test_a_window_that_a_monitor_measures_is_not_said_to_be_unseen() -> None:
    report = selftest_rig(load_ohm=None).run()
    assert by_name(report)["heartbeat_window"].result == "pass"
    assert not any("window" in one for one in report.not_seen)


def test_what_no_check_can_see_is_said_in_the_report() -> None:
    report = selftest_rig(faults=[LineCut("POL")]).run()
    assert report.passed
    assert any("POL" in sentence for sentence in report.not_seen)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (LineCut("SYNC"), "a wire of SYNC"),
        (StuckBehind("POL", 0), "held low there"),
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
    bed = Bed(rig.loaded, rig.bench, rig.hand, rig.asked)

    def on_check(check: Check) -> None:
        if check.name == "ua_per_code":
            rig.fake.world.put_in(LatchIgnored(every=1))

    report = run(bed, DATE, on_check=on_check)
    assert bad(report)[0] == ("probe", "blanked")


def test_an_error_ends_in_the_safe_state_all_the_same() -> None:
    rig = selftest_rig()
    bed = Bed(rig.loaded, rig.bench, rig.hand, rig.asked)

    def interrupt(name: str, _what: str) -> None:
        if name == "probe":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(bed, DATE, on_stage=interrupt)
    assert not bed.board.is_supply_on
    assert rig.rail_v_after_a_while() < 30


def test_an_interrupted_test_says_why_the_board_is_not_safe(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rig = selftest_rig()
    bed = Bed(rig.loaded, rig.bench, rig.hand, rig.asked)

    def interrupt(name: str, _what: str) -> None:
        if name == "probe":
            for number in range(1, 20):
                rig.fake.world.put_in(SpiError(at_message=number))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(bed, DATE, on_stage=interrupt)
    told = capsys.readouterr().err
    assert "NOT SAFE" in told
    assert "cut the supply by hand" in told
