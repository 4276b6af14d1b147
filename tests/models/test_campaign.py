"""The fault campaign: its judge, and a bounded part of it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from campaign import docs
from campaign.account import AccountedBody, Course
from campaign.case import Outcome
from campaign.engine_script import ELECTRODES, PULSE_PC, WANTED_UA, EngineScript
from campaign.forked import whole
from campaign.judge import GUARDED, PAIR, Bound, bounds, lines_not_met, not_met
from campaign.kinds import kinds_of
from campaign.operations import Operations
from campaign.record import Line, in_all, lines_of, merged, played, record, recorded
from campaign.results import BENCH, figures, is_silent
from campaign.scene import Over
from campaign.scenes import BOARDS, SCENES, config
from charge_witness import even_skin
from engine_scenes import states
from etd_body.interface import Side
from etd_hal.fake.faults import Fault

#: How a self-test that is killed is told.
NO_REPORT = "it ends without a report"
CLONE = Path(__file__).resolve().parents[2]
RUN = CLONE / "tests" / "campaign" / "run.py"
US = 1_000


def sides(alone: int, side: Side) -> tuple[Side, ...]:
    other = Side.GROUND if side is Side.SOURCE else Side.SOURCE
    return tuple(side if electrode == alone else other for electrode in range(ELECTRODES))


@pytest.mark.parametrize("side", [Side.SOURCE, Side.GROUND])
def test_the_account_tells_who_was_alone_and_for_how_long(side: Side) -> None:
    board = config("kajimoto-hv507").board
    body = AccountedBody(even_skin(board, ELECTRODES))
    for begun_us in (0, 500):
        body.drive(begun_us * US, 1_000.0, sides(3, side))
        body.drive((begun_us + 100) * US, 0.0, sides(3, side))
    body.drive(1_000 * US, 1_000.0, sides(5, side))
    found = body.account(1_050 * US)
    # The board's leak takes its part of 1 mA for 100 us.
    assert 70_000 < found.longest_alone_pc < 100_000
    assert found.alone_pc[3] == pytest.approx(2 * found.longest_alone_pc)
    assert found.alone_pc[5] == pytest.approx(found.longest_alone_pc / 2)
    assert found.shared_pc[0] == pytest.approx(2.5 * found.longest_shared_pc)
    assert found.longest_shared_pc == pytest.approx(found.longest_alone_pc / 7)


def test_a_course_tells_what_had_flowed_by_when() -> None:
    board, course = config("kajimoto-hv507").board, Course()
    body = AccountedBody(even_skin(board, ELECTRODES), course)
    for begun_us in (0, 500):
        body.drive(begun_us * US, 1_000.0, sides(3, Side.SOURCE))
        body.drive((begun_us + 100) * US, 0.0, sides(3, Side.SOURCE))
    assert course.until(50 * US) is None
    first, both = course.until(400 * US), course.until(600 * US)
    assert first is not None
    assert both == course.last
    assert both.alone_pc[3] == pytest.approx(2 * first.alone_pc[3])
    body.mark(700 * US)
    assert body.first_ns is None
    body.drive(800 * US, 1_000.0, sides(5, Side.SOURCE))
    body.drive(900 * US, 0.0, sides(5, Side.SOURCE))
    assert body.last_ns == 900 * US


@pytest.mark.parametrize("board", BOARDS)
def test_without_a_fault_each_lit_electrode_gets_its_pulses(board: str) -> None:
    found = whole(board, "frames")
    allowed = found.course.last
    lit = [electrode for electrode, wanted_ua in enumerate(WANTED_UA) if wanted_ua]
    silent = [electrode for electrode in range(ELECTRODES) if electrode not in lit]
    # Two pulses a frame, one of two phases; then 40 a second, for longer than any check takes.
    most_pc = (2 * 4 + 46) * PULSE_PC
    assert all(0.7 * most_pc < allowed.alone_pc[electrode] < 1.2 * most_pc for electrode in lit)
    assert all(allowed.alone_pc[electrode] < 0.2 * most_pc for electrode in silent)
    assert allowed.longest_alone_pc < PULSE_PC
    assert {"spi", "set"} <= {one.port for one in found.operations}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("board", BOARDS)
def test_every_scene_runs_without_a_fault(board: str, scene: str) -> None:
    """`whole` raises where one is refused something or halts."""
    assert len(whole(board, scene).operations) > 100


@pytest.mark.parametrize("board", BOARDS)
def test_the_balanced_frames_have_both_phases(board: str) -> None:
    played = SCENES["balanced frames"](config(board), Operations(), None)
    assert isinstance(played, EngineScript)
    played.prepare()
    played.play()
    played.play_on(is_long=True)
    assert played.problem() is None
    assert played.pulse_pc == 2 * PULSE_PC
    counters = states(played.rig)[-1].counters
    assert counters["balanced"] >= 10
    assert "net_charge" not in counters
    played.close()


def test_what_an_operation_is_told_happens_to_it() -> None:
    operations = Operations()
    played = SCENES["arming"](config("kajimoto-hv507"), operations, None)
    played.prepare()
    operations.before = lambda number, port: "io" if port == "spi" else None
    with pytest.raises(Over):
        played.play()
    assert played.said(0).seen == "halted"
    played.subject.fake.world.mend()
    operations.before = lambda *_: None
    played.close()


def test_every_board_has_kinds_of_its_guards() -> None:
    names = {board: {kind.fault_class for kind in kinds_of(config(board).board, on_bench=True)}
             for board in BOARDS}  # fmt: skip
    assert names["reference-hv507"] - names["kajimoto-hv507"] == {
        "the supply cannot be switched off",
        "the rail's sensor lies",
        "the rail's sensor says too little or too much",
        "the rail's sensor is gone",
        "the sensors hang",
        "the heartbeat is ignored",
        "the heartbeat's gate is not as it should be",
        "the set-point wakes up high",
        "a stop does not cut the supply",
    }
    assert set.union(*names.values()) | {"two at once"} == set(bounds())


def test_every_fault_of_the_fake_is_played() -> None:
    """A new one has to be put in somewhere: none is left out."""
    kinds = [one for board in BOARDS for one in kinds_of(config(board).board, on_bench=True)]
    played = {type(kind.fault) for kind in kinds}
    assert set(Fault.__subclasses__()) - played == set()


def test_what_is_said_to_tell_a_class_is_a_row_of_the_page() -> None:
    page = docs.PAGE.read_text(encoding="utf-8")
    rows = {line.split("|")[1].strip() for line in page.splitlines() if line.startswith("| ")}
    for name, bound in bounds().items():
        assert {*bound.told_by, *bound.guarded_by} <= rows, name
        is_told = bool(bound.told_by) and not bound.silent_on and not bound.in_step_uc
        assert is_told or bound.why, f"{name}: nothing tells it, and nothing says why"


def checks_named(page: str) -> set[str]:
    """Those of which docs/bring-up.md says what to do: a row names some of one stage."""
    found = set[str]()
    for line in page.splitlines():
        if not line.startswith("| ") or ":" not in line.split("|")[1]:
            continue
        stage = ""
        for part in re.findall(r"`([^`]+)`", line.split("|")[1]):
            stage, name = part.split(": ") if ": " in part else (stage, part)
            found.add(f"{stage or 'any stage'}: {name}")
    return found


def told(**changed: Any) -> Outcome:
    facts: dict[str, Any] = {
        "board": GUARDED,
        "scene": "frames",
        "kind": "a gain: twice",
        "fault_class": "a gain",
        "operation": 7,
        "port": "spi",
        "seen": "nothing",
        "halted_after_ms": None,
        "flowed_for_ms": 0.0,
        "beyond_alone_pc": 0.0,
        "beyond_shared_pc": 0.0,
        "pulse_pc": PULSE_PC,
    }
    return Outcome(**{**facts, **changed})


def test_what_does_not_hold_is_said() -> None:
    row = Bound(told_by=("a check",), uc={GUARDED: 9.0, "kajimoto-hv507": 9.0})
    halted = told(seen="halted", beyond_alone_pc=2.4e6)
    assert not_met([told(), halted], {"a gain": row}) == []
    for broken, why in (
        (told(seen="halted", beyond_alone_pc=2.6e6), "no hardware is named"),
        (told(seen="halted", beyond_shared_pc=9.1e6), "more than the 9 uC"),
        (told(beyond_shared_pc=9_000.0), "in silence, and it should be told by a check"),
        (told(seen="crashed: TypeError()"), "TypeError"),
        (told(fault_class="another"), "no row"),
        (told(seen="ended", leaves_supply_on=True), "the supply was left on"),
    ):
        (sentence,) = not_met([told(), broken], {"a gain": row})
        assert "operation 7" in sentence
        assert why in sentence
    without_guards = told(board="kajimoto-hv507", seen="halted", beyond_alone_pc=2.6e6)
    assert not_met([without_guards], {"a gain": row}) == []
    late = Bound(leaves_supply_on="why", within_ms={GUARDED: 260.0}, uc={GUARDED: 1.0})
    on_time = told(seen="halted", flowed_for_ms=260.0, leaves_supply_on=True)
    assert not_met([on_time], {"a gain": late}) == []
    (sentence,) = not_met([told(seen="halted", flowed_for_ms=260.1)], {"a gain": late})
    assert "260.1 ms until it is silent, more than the 260 ms of its row" in sentence
    silent_there = Bound(told_by=("a check",), silent_on=(GUARDED,), uc={GUARDED: 1.0})
    assert not_met([told(beyond_shared_pc=9_000.0)], {"a gain": silent_there}) == []
    in_step = Bound(told_by=("a check",), in_step_uc=0.009, uc={GUARDED: 1.0})
    assert not_met([told(beyond_shared_pc=9_000.0)], {"a gain": in_step}) == []
    (too_much,) = not_met([told(beyond_shared_pc=9_001.0)], {"a gain": in_step})
    assert "in silence" in too_much


def test_a_self_test_is_judged_by_what_it_is_to_tell() -> None:
    """At the bench: by its own row, and not by what a board with a person is asked."""
    row = Bound(selftest=("switches: every_switch",), selftest_silent_uc=0.006, uc={BENCH: 9.0})
    silent = told(scene=BENCH, beyond_alone_pc=9_000.0)
    (sentence,) = not_met([silent], {"a gain": row})
    assert "in silence, and it should be told by switches: every_switch" in sentence
    told_by_nothing = Bound(selftest_why="once", uc={BENCH: 9.0})
    assert not_met([silent], {"a gain": told_by_nothing}) == []
    after_it = told(scene=BENCH, beyond_alone_pc=5_000.0)
    refused = told(scene=BENCH, seen="refused", beyond_alone_pc=8.0e6)
    assert not_met([after_it, refused], {"a gain": row}) == []
    (too_much,) = not_met(
        [told(scene=BENCH, seen="refused", beyond_alone_pc=9.1e6)], {"a gain": row}
    )
    assert "more than the 9 uC" in too_much


def test_what_a_self_test_is_to_tell_is_a_check_of_it_or_it_says_why_not() -> None:
    page = (CLONE / "docs" / "bring-up.md").read_text(encoding="utf-8")
    checks = checks_named(page) | {NO_REPORT}
    for name, bound in bounds().items():
        assert set(bound.selftest) <= checks, name
        if BENCH in bound.uc:
            assert bound.selftest or bound.selftest_why, f"{name}: the self-test says nothing of it"


def test_a_pair_may_pass_what_the_guards_let_through_only_where_one_of_the_two_may() -> None:
    rows = {
        "two at once": Bound(uc={GUARDED: 9.0}),
        "a gain": Bound(uc={GUARDED: 1.0}),
        "an overshoot": Bound(uc={GUARDED: 1.0}, needs="a limiter"),
    }
    for pair, holds in (
        ("a gain: G(2), then a gain: G(3) after 7", False),
        ("a gain: G(2), then an overshoot: O(3) after 7", True),
        ("an overshoot: O(3), then a gain: G(2) after 7", True),
    ):
        found = told(kind=f"two at once: {pair}", fault_class="two at once", beyond_alone_pc=2.6e6)
        assert (not_met([found], rows) == []) is holds


def test_a_pair_may_let_through_what_either_of_the_two_may() -> None:
    gain = Bound(uc={GUARDED: 1.0, BENCH: 30.0}, needs="a limiter", in_pair_uc=39.0)
    rows = {PAIR: Bound(uc={GUARDED: 3.5, BENCH: 25.0}), "a gain": gain, "a stop": Bound()}

    def holds(uc: float, scene: str = "frames", second: str = "a gain") -> bool:
        pair = f"{PAIR}: a stop: S(), then {second}: G(2) after 7"
        one = told(kind=pair, fault_class=PAIR, scene=scene, beyond_alone_pc=uc * 1e6)
        return not_met([one], rows) == []

    assert holds(39.0)
    assert not holds(39.1)
    assert not holds(2.6, second="a stop")
    assert holds(30.0, BENCH)
    assert not holds(30.1, BENCH)
    assert not holds(25.1, BENCH, "a stop")
    alone = told(beyond_alone_pc=1.1e6)
    assert not_met([alone], rows) != []


def test_with_stronger_pulses_a_class_may_let_more_through() -> None:
    rows = {"a gain": Bound(why="drift", uc={"kajimoto-hv507": 0.05})}
    weak = told(board="kajimoto-hv507", beyond_alone_pc=90_000.0)
    strong = told(board="kajimoto-hv507", beyond_alone_pc=90_000.0, pulse_pc=2 * PULSE_PC)
    assert not_met([strong], rows) == []
    assert "0.090 uC, more than the 0.05 uC" in not_met([weak], rows)[0]
    assert is_silent(told(beyond_alone_pc=5_000.0))
    assert not is_silent(told(beyond_alone_pc=5_000.0, pulse_pc=2 * PULSE_PC))
    pair = [("kajimoto-hv507", PULSE_PC), ("kajimoto-hv507", 2 * PULSE_PC)]
    titles = [title for title, _ in docs.tables(lines_of([weak, strong], "At all"))]
    assert titles == [
        f"On `{board}`, pulses of {pulse_pc / 1e6:.3f} uC, 1 cases" for board, pulse_pc in pair
    ]


def test_a_class_has_its_worst_and_what_nothing_was_said_of() -> None:
    (found,) = figures(
        [
            told(),
            told(beyond_alone_pc=50_000.0),
            told(seen="halted", flowed_for_ms=2.0, beyond_shared_pc=9_000.0),
            told(seen="ended", flowed_for_ms=8.0),
        ]
    )
    assert (found.cases, found.told, found.latent, found.silent) == (4, 2, 1, 1)
    assert (found.safe_most_ms, found.most_alone_uc, found.most_shared_uc) == (8.0, 0.05, 0.009)
    assert is_silent(told(beyond_shared_pc=5_000.0))
    assert not is_silent(told(seen="refused", beyond_shared_pc=5_000.0))


def test_what_was_played_anew_takes_the_place_of_its_class_and_the_rest_says_when_it_was(
    tmp_path: Path,
) -> None:
    def line(name: str, version: str, day: str, how: str, **changed: Any) -> Line:
        facts = {"fault_class": name, "version": version, "played": f"{day} 08:59 UTC", **changed}
        (found,) = lines_of([told(**facts), told(**facts)], how)
        return found

    first = [line(name, "abc", "2026-11-01", "At all") for name in ("a gain", "an overshoot")]
    facts = {"seen": "halted", "flowed_for_ms": 2.0, "processor_s": 1_830.0}
    later = [line(name, "def", "2026-11-02", "At some", **facts) for name in ("a gain", "a stop")]
    record(merged(first, later), tmp_path / "kept")
    assert recorded(tmp_path / "kept") == [later[0], first[1], later[1]]
    assert docs.said(recorded(tmp_path / "kept")) == (
        "At some: 4 cases by def on 2026-11-02 (1 h 1 min of 2 processors). 2 cases by abc on"
        " 2026-11-01, at all: an overshoot."
    )
    (row,) = in_all(recorded(tmp_path / "kept"))
    assert (row["cases"], row["told"], row["latent"], row["safe_most_ms"]) == (6, 4, 2, 2.0)
    assert [part["classes"] for part in played(first)] == [["all"]]
    bench = line("a gain", "ghi", "2026-11-03", "At all", scene=BENCH)
    assert [part["classes"] for part in played([*first, bench])] == [
        ["all others"],
        ["all of self-test"],
    ]
    parts = played(recorded(tmp_path / "kept"))
    assert [part["classes"] for part in parts] == [["all others"], ["an overshoot"]]


def test_the_page_says_how_much_was_silent_of_what_something_tells() -> None:
    """By strength of the pulses; a self-test apart, since no person is there."""

    def said(*found: Outcome) -> str:
        return docs.of_silence(lines_of(found, ""))

    in_step = "bits to the DAC are flipped"
    small = told(fault_class=in_step, beyond_alone_pc=9_000.0)
    at_bench = told(fault_class=in_step, scene=BENCH, beyond_shared_pc=20_000.0)
    assert said(told(fault_class="an overshoot", beyond_alone_pc=9_000.0)) == ""
    assert said(small, at_bench, told(fault_class=in_step, seen="halted")) == (
        "Of classes that something tells 2 of 3 cases were silent: 1 of them of 0.009 uC at most,"
        " and 1 of them of 0.020 uC at most in a self-test."
    )
    (unkept,) = (replace(one, silent_most_uc=None) for one in lines_of([at_bench], ""))
    assert docs.of_silence([unkept]).endswith(
        "1 of them of a size that was not kept in a self-test."
    )


def test_what_is_recorded_is_judged_by_its_rows_as_well() -> None:
    def found(**changed: Any) -> list[str]:
        return lines_not_met(lines_of([told(**changed)], ""), rows)

    rows = {"a gain": Bound(told_by=("a check",), uc={GUARDED: 9.0, BENCH: 9.0})}
    assert found() == found(scene=BENCH, beyond_alone_pc=9_000.0) == []
    assert "with all guards" in found(seen="halted", beyond_alone_pc=2.6e6)[0]
    assert "more than the 9 uC" in found(seen="halted", beyond_alone_pc=9.1e6)[0]
    assert "1 in silence" in found(beyond_alone_pc=9_000.0)[0]
    rows["in step"] = Bound(told_by=("a check",), in_step_uc=0.009, uc={GUARDED: 9.0})
    assert found(fault_class="in step", beyond_alone_pc=9_000.0) == []
    assert (
        "1 in silence, of 0.009 uC at most"
        in found(fault_class="in step", beyond_alone_pc=9_001.0)[0]
    )
    strong = 4 * PULSE_PC
    assert found(fault_class="in step", beyond_alone_pc=36_000.0, pulse_pc=strong) == []
    assert found(fault_class="in step", beyond_alone_pc=36_001.0, pulse_pc=strong) != []
    rows["late"] = Bound(told_by=("a check",), within_ms={GUARDED: 2.0}, uc={GUARDED: 9.0})
    assert found(fault_class="late", seen="halted", flowed_for_ms=2.0) == []
    assert "2.1 ms until" in found(fault_class="late", seen="halted", flowed_for_ms=2.1)[0]
    assert "no row" in found(fault_class="another")[0]
    assert "an error of their own" in found(seen="crashed: TypeError()")[0]


def test_the_page_and_the_record_agree_and_hold() -> None:
    lines = recorded()
    assert {line.fault_class for line in lines} == set(bounds())
    assert lines_not_met(lines, bounds()) == []
    page = docs.PAGE.read_text(encoding="utf-8")
    for title, rows in docs.tables(lines):
        assert f"\n{title}:\n" in page
        assert all("| " + " | ".join(row) + " |\n" in page for row in rows)


def test_what_is_told_has_a_bound_on_its_time() -> None:
    """But where the hardware is named that would end it sooner."""
    for line in recorded():
        row = bounds()[line.fault_class]
        is_told = bool(row.rows_on(line.on)) and line.safe_most_ms is not None
        if is_told and line.on != BENCH and not row.needs:
            assert line.on in row.within_ms, f"{line.fault_class} on {line.on}"


PARTS = (["--scenes", "frames", BENCH], ["--boards", GUARDED], ["--bounded"], ["--only", "an edge"])


@pytest.mark.parametrize("part", PARTS, ids=" ".join)
def test_a_part_of_a_class_is_not_written(part: list[str], tmp_path: Path) -> None:
    """Nothing is played, nor would anything be kept there."""
    asked = [sys.executable, str(RUN), "--kept", "--write", "--folder", str(tmp_path), *part]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert (done.returncode, "--write with" in done.stderr) == (2, True)
