"""The bench of laws on bodies: what it calls harm, that it keeps what it played, and its short
form, with the bounds of what ships or is recommended.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import asdict, replace
from itertools import product
from math import inf, isnan, nan
from pathlib import Path

import msgspec
import pytest

from bench import steady_cells
from bench.fresh_seeds import LOOKED_AT, STEADY, TESTED
from bench.steady_bodies import SHORT, cells, judged, play
from bench.steady_cells import Cell
from bench.steady_docs import PAGE, write_harms
from bench.steady_exclusions import documented
from bench.steady_figures import SteadyFigures
from bench.steady_harm import BOUND, FOLLOWING, HALF, Harm, exclusions, halved, harms, held
from bench.steady_laws import (
    AHEAD,
    FOR_SHORT,
    FOR_STEADINESS,
    LAWS,
    NONE,
    OWN,
    SHIPPED,
)
from etd_body.kinds import BodyKind

LAW, BODY, SEED = "energy", BodyKind.INDIFFERENT, 1
PLAIN = SteadyFigures(NONE, 2.0, 0.1, 0.1, 0.05, 0.0, 0, 0, 0.9, None, None, 0, 0, 0, 0, 1_000)
KEPT = replace(PLAIN, name=LAW, over_time=0.119, below_threshold=0.059)


def found(with_law: SteadyFigures, plain: SteadyFigures = PLAIN) -> Harm:
    (harm,) = harms({(BODY, LAW, SEED): with_law, (BODY, NONE, SEED): plain})
    return harm


SILENT = replace(KEPT, over_time=nan, over_electrodes=nan, below_threshold=1.0, mean_felt=0.0)


def test_a_law_that_silences_a_finger_is_out_and_hides_nothing_of_another() -> None:
    assert found(SILENT).is_out
    assert found(SILENT).variation_times == inf
    assert found(SILENT, replace(SILENT, name=NONE)).worst == 1.0
    hurts = replace(KEPT, scans_above_pain=900)
    of_two = {(BODY, LAW, 1): SILENT, (BODY, LAW, 2): hurts} | {
        (BODY, NONE, seed): PLAIN for seed in (1, 2)
    }
    (harm,) = harms(of_two)
    assert harm.is_out
    assert sum(not bound.is_met for bound in harm.bounds()) == 3
    in_reach, *_ = harms({(BODY, LAW, 1): KEPT, (BODY, NONE, 1): SILENT})
    assert in_reach.variation_times == 1.0, "a law by which something is felt at last"


def test_a_finger_on_which_nothing_is_felt_is_kept_and_read_again(tmp_path: Path) -> None:
    cell = Cell(SHORT, BODY, LAW, SEED)
    path = cell.path(tmp_path)
    path.parent.mkdir(parents=True)
    path.write_bytes(msgspec.json.encode(asdict(SILENT)))
    again = cell.kept(tmp_path)
    assert again is not None
    assert isnan(again.over_time)
    assert replace(again, over_time=0.0, over_electrodes=0.0) == replace(
        SILENT, over_time=0.0, over_electrodes=0.0
    )


def test_what_stays_within_the_bounds_is_not_out() -> None:
    assert not found(KEPT).is_out
    assert all(bound.is_met for bound in found(KEPT).bounds())


@pytest.mark.parametrize(
    "worse",
    [
        replace(KEPT, over_time=0.121),
        replace(KEPT, below_threshold=0.061),
        replace(KEPT, scans_above_pain=1),
    ],
)
def test_each_bound_can_say_no(worse: SteadyFigures) -> None:
    harm = found(worse)
    assert harm.is_out
    assert sum(not bound.is_met for bound in harm.bounds()) == 1
    assert exclusions([harm]) == {LAW: [BODY]}


def test_what_hurts_without_a_law_may_not_hurt_much_more_with_one() -> None:
    hurting = replace(PLAIN, scans_above_pain=10)
    assert not found(replace(KEPT, scans_above_pain=12), hurting).is_out
    assert found(replace(KEPT, scans_above_pain=13), hurting).is_out


def test_what_is_not_felt_where_all_is_felt_without_a_law_is_out() -> None:
    assert found(KEPT, replace(PLAIN, below_threshold=0.0)).is_out
    assert not found(replace(KEPT, below_threshold=0.0), replace(PLAIN, below_threshold=0.0)).is_out


def test_fingers_are_pooled_and_only_those_with_both_count() -> None:
    other = replace(PLAIN, over_time=0.3)
    (harm,) = harms(
        {
            (BODY, LAW, 1): KEPT,
            (BODY, NONE, 1): PLAIN,
            (BODY, LAW, 2): replace(KEPT, over_time=0.319),
            (BODY, NONE, 2): other,
            (BODY, LAW, 3): replace(KEPT, over_time=9.0),
        }
    )
    assert harm.fingers == 2
    assert harm.variation_times == pytest.approx((0.119 + 0.319) / 0.4)


def test_the_worst_comes_first() -> None:
    figures = {(body, NONE, SEED): PLAIN for body in BodyKind}
    figures |= {(body, LAW, SEED): KEPT for body in BodyKind}
    figures[BodyKind.DUCTS, LAW, SEED] = replace(KEPT, over_time=0.5)
    figures[BodyKind.SWEAT, LAW, SEED] = replace(KEPT, scans_above_pain=2)
    assert [harm.body for harm in harms(figures)[:2]] == [BodyKind.SWEAT, BodyKind.DUCTS]


def test_a_bound_law_that_was_not_played_on_a_body_is_not_met() -> None:
    bounds = held([found(KEPT)], [LAW])
    unmet = [bound.what for bound in bounds if not bound.is_met]
    assert len(unmet) == len(BodyKind) - 1
    assert all("not played" in what for what in unmet)


def own(over_time: float, *, is_refused: bool = False) -> Harm:
    law = replace(PLAIN, name=OWN, over_time=over_time, is_refused=is_refused)
    (harm,) = harms({(FOLLOWING, OWN, SEED): law, (FOLLOWING, NONE, SEED): PLAIN})
    return harm


@pytest.mark.parametrize(("left", "is_met"), [(HALF, True), (HALF + 0.01, False)])
def test_by_a_k_of_ones_own_variation_is_halved_where_feeling_follows_resistance(
    left: float, is_met: bool
) -> None:
    assert halved([found(KEPT), own(left * PLAIN.over_time)]).is_met is is_met


def test_what_was_not_played_has_halved_nothing() -> None:
    assert not halved([found(KEPT)]).is_met


def test_who_is_refused_has_no_law_and_so_no_harm_and_nothing_halved() -> None:
    harm = own(PLAIN.over_time, is_refused=True)
    assert (harm.is_out, harm.with_law.refused, harm.fingers) == (False, 1, 1)
    assert not halved([harm]).is_met


def test_a_cell_of_the_table_says_who_is_refused(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    some = replace(own(0.05), fingers=2)
    write_harms(page, "full", [own(0.1, is_refused=True)], "said")
    assert f"| {OWN} | refused |" in page.read_text(encoding="utf-8")
    some = replace(some, with_law=replace(some.with_law, refused=1))
    write_harms(page, "full", [some], "said")
    assert f"| {OWN} | 5%, 5%, 0 (1 refused) |" in page.read_text(encoding="utf-8")


def test_the_fingers_of_the_full_form_are_not_those_that_are_looked_at() -> None:
    assert not set(STEADY) & LOOKED_AT


def test_no_law_is_played_first_on_every_body_of_a_finger() -> None:
    order = cells(SHORT, FOR_STEADINESS, list(BodyKind), (1, 2))
    assert len(order) == 2 * len(FOR_STEADINESS) * len(BodyKind)
    assert {cell.law for cell in order[: len(BodyKind)]} == {NONE}
    assert {cell.seed for cell in order[: len(order) // 2]} == {1}


def test_what_was_played_is_kept_and_other_code_finds_none_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = Cell(replace(SHORT, minutes=0.5, pieces=1), BODY, NONE, TESTED[0])
    assert cell.kept(tmp_path) is None
    played = cell.played(tmp_path)
    monkeypatch.setitem(LAWS, NONE, None)
    assert cell.played(tmp_path) == cell.kept(tmp_path) == played
    monkeypatch.setattr(steady_cells, "digest", lambda: "another")
    assert cell.kept(tmp_path) is None


#: What is played on one body each: all of the short form but what is played on all.
ON_ONE = tuple(law for law in FOR_SHORT if law not in (NONE, OWN, *SHIPPED))


def its_turn(law: str, digest: str) -> BodyKind:
    """A body that is no exclusion of the law in the short form: by turns, as the code that plays it
    changes, so that none is left out for good. The same code is always judged on the same.
    """
    excluded = documented()[law].on(SHORT.name)
    left = [body for body in BodyKind if body not in excluded]
    return left[int(digest, 16) % len(left)]


#: By laws by resistance these are out, where feeling does not follow it.
OUT_BY_RESISTANCE = (BodyKind.INDIFFERENT, BodyKind.DUCTS)


def test_the_short_form_keeps_to_its_documented_exclusions(tmp_path: Path) -> None:
    """8 electrodes, four pieces of ten minutes of one finger: what ships or is recommended keeps
    the bounds on every body, what is nearest to it is out where it is excluded, and nowhere else,
    and each other law is not out on a body that is no exclusion of it. The full chain is out where
    feeling does not follow resistance. All in one run: no law on a body is played once.
    """
    on_all = (*BOUND, OWN)
    one_each = [(law, its_turn(law, steady_cells.digest())) for law in ON_ONE]
    one_each += [(AHEAD, body) for body in OUT_BY_RESISTANCE]
    wanted = cells(SHORT, on_all, list(BodyKind), TESTED)
    wanted += [Cell(SHORT, body, law, TESTED[0]) for law, body in one_each]
    made = harms(play(wanted, processes=1, within_s=3_600.0, folder=tmp_path))
    assert {(harm.law, harm.body) for harm in made} == {*product(on_all, BodyKind), *one_each}
    unmet = [bound for bound in judged(SHORT.name, made, documented(), 0) if not bound.is_met]
    assert unmet == []
    assert set(exclusions(made)[OWN]) == set(documented()[OWN].on(SHORT.name))
    by_both = {(harm.law, harm.body): harm for harm in made}
    for body in OUT_BY_RESISTANCE:
        assert by_both[AHEAD, body].variation_times > 1.5


def test_in_time_each_law_of_the_short_form_is_played_wherever_it_is_no_exclusion() -> None:
    for law in ON_ONE:
        played = {its_turn(law, f"{number:x}") for number in range(len(BodyKind))}
        assert played == set(BodyKind) - set(documented()[law].on(SHORT.name)), law


def test_a_run_that_is_cut_goes_on_where_it_stopped(tmp_path: Path) -> None:
    form = replace(SHORT, minutes=0.5, pieces=1)
    wanted = cells(form, [NONE], list(BodyKind)[:3], TESTED)
    first = wanted[0].played(tmp_path)
    cut = play(wanted, processes=1, within_s=0.0, folder=tmp_path)
    assert cut == {(wanted[0].body, NONE, TESTED[0]): first}
    whole = play(wanted, processes=2, within_s=600.0, folder=tmp_path)
    assert len(whole) == len(wanted)
    assert {key: whole[key] for key in cut} == cut


def test_what_a_run_loads_of_this_clone_is_what_the_digest_is_of(tmp_path: Path) -> None:
    """A module that plays a result, and is not among them, could change under what is kept."""
    code = (
        "import sys; from pathlib import Path; from dataclasses import replace\n"
        "from bench.steady_cells import Cell, Form, played_by\n"
        "from etd_body.kinds import BodyKind\n"
        "Cell(Form('f', 8, 0.5, 1), BodyKind.AREA, 'contact + power_law + probe, own k', 31)"
        f".played(Path({str(tmp_path)!r}))\n"
        "clone = Path(sys.path[0]).parent\n"
        "files = {Path(it.__file__).resolve() for it in list(sys.modules.values())"
        " if getattr(it, '__file__', None)}\n"
        "ours = {it for it in files if any(clone / one in it.parents for one in"
        " ('daemon', 'hal', 'tests'))}\n"
        "print(len(ours), sorted(map(str, ours - played_by())))"
    )
    tests = Path(steady_cells.__file__).resolve().parents[1]
    ran = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = [{str(tests)!r}]\n{code}"],
        capture_output=True,
        text=True,
        check=True,
    )
    count, _, missing = ran.stdout.partition(" ")
    assert missing.strip() == "[]"
    assert int(count) > 100


def test_where_the_fit_refuses_the_figures_are_of_no_law(tmp_path: Path) -> None:
    form = replace(SHORT, minutes=0.5, pieces=1)
    refused = Cell(form, BodyKind.TENDER, OWN, TESTED[0]).played(tmp_path)
    plain = Cell(form, BodyKind.TENDER, NONE, TESTED[0]).kept(tmp_path)
    assert plain is not None
    assert refused == replace(plain, name=OWN, is_refused=True)
