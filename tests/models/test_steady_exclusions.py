"""The documented exclusions: their file, what a run says against them, what is written of both."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from bench import steady_bodies, steady_docs, steady_opening
from bench.fresh_seeds import TESTED
from bench.steady_bodies import LAWS_OF, UNBROKEN, judged, write_docs
from bench.steady_cells import Form, played_by
from bench.steady_exclusions import (
    FILE,
    Excluded,
    back_in,
    documented,
    free_of_exclusions,
    not_excluded,
)
from bench.steady_figures import SteadyFigures
from bench.steady_harm import BOUND, Harm, harms, worst_fingers
from bench.steady_laws import CONTACT, NONE, OWN
from etd_body.kinds import BodyKind

PLAIN = SteadyFigures(NONE, 2.0, 0.1, 0.1, 0.05, 0.0, 0, 0, 0.9, None, None, 0, 0, 0, 0, 1_000)
WORSE = replace(PLAIN, over_time=0.125)
OUT, IN = BodyKind.DUCTS, BodyKind.SUMMING
KNOWN = {CONTACT: Excluded(short=(OUT,), why="as it is")}


def made(figures: SteadyFigures, *bodies: BodyKind, law: str = CONTACT) -> list[Harm]:
    of_law = {(body, law, 1): replace(figures, name=law) for body in bodies}
    return harms(of_law | {(body, NONE, 1): PLAIN for body in bodies})


def test_what_is_out_on_an_exclusion_of_the_form_holds_and_elsewhere_does_not() -> None:
    assert not_excluded(made(WORSE, OUT), "short", KNOWN) == []
    (unmet,) = not_excluded(made(WORSE, IN, OUT), "short", KNOWN)
    assert not unmet.is_met
    assert unmet.what.startswith(f"{CONTACT} on {IN}: out of bounds, and no documented exclusion")
    assert (unmet.value, unmet.bound) == (1.25, 1.2)
    assert len(not_excluded(made(WORSE, OUT), "full", KNOWN)) == 1
    assert len(not_excluded(made(WORSE, OUT), "short", {})) == 1


def test_an_exclusion_that_was_within_the_bounds_is_told_and_does_not_fail() -> None:
    (told,) = back_in(made(PLAIN, IN, OUT), "short", KNOWN)
    assert told.startswith(f"{CONTACT} on {OUT}: within the bounds this time")
    assert back_in(made(PLAIN, OUT), "full", KNOWN) == []
    assert all(bound.is_met for bound in judged("short", made(PLAIN, IN, OUT), KNOWN, 0))


def test_what_ships_or_is_recommended_has_no_exclusion_in_either_form() -> None:
    (unmet,) = free_of_exclusions(KNOWN, [CONTACT])
    assert (unmet.is_met, unmet.value) == (False, 1)
    assert all(bound.is_met for bound in free_of_exclusions(KNOWN, ["energy"]))
    assert all(bound.is_met for bound in free_of_exclusions(documented(), BOUND))


def test_a_run_that_was_cut_does_not_hold() -> None:
    unmet = [bound for bound in judged("short", made(PLAIN, IN), KNOWN, 3) if not bound.is_met]
    assert [(bound.what, bound.value) for bound in unmet] == [("runs that were not played", 3)]


def test_every_law_that_a_form_plays_is_documented_for_it() -> None:
    known = documented()
    for form, laws in LAWS_OF.items():
        documented_for_it = {law for law in known if known[law].by_form[form.name] is not None}
        assert documented_for_it == set(laws) - {NONE}


@pytest.mark.parametrize(
    "text",
    [
        '[magic]\nwhy = "none"\n',
        '[contact]\nfull = ["area"]\n',
        '[contact]\nfull = ["hand"]\nwhy = "no such body"\n',
        '[contact]\nlong = ["area"]\nwhy = "no such form"\n',
    ],
)
def test_a_file_that_says_nothing_that_can_be_judged_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / FILE.name
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"magic|why|hand|long"):
        documented(file)


@pytest.mark.parametrize(("body", "status"), [(OUT, 0), (IN, 1)])
def test_the_command_fails_where_a_law_is_out_and_not_excluded(
    body: BodyKind,
    status: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """`contact` is excluded on ducts, not on summing: by figures that are given, not played."""
    found = {(body, CONTACT, 31): replace(WORSE, name=CONTACT), (body, NONE, 31): PLAIN}
    monkeypatch.setattr(steady_bodies, "play", lambda wanted, **_: found)
    options = ["--short", "--only", NONE, CONTACT, "--bodies", body.value]
    monkeypatch.setattr(sys, "argv", ["bench-steady", *options])
    assert steady_bodies.main() == status
    said = capsys.readouterr().out
    assert ("no documented exclusion of the short form" in said) is bool(status)


def test_a_part_of_a_form_is_not_written_into_the_docs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["bench-steady", "--write-docs", "--only", NONE])
    with pytest.raises(SystemExit):
        steady_bodies.main()
    assert "all laws of the form" in capsys.readouterr().err


def test_the_worst_finger_of_a_law_is_told_where_the_pooled_ones_are_within_the_bounds() -> None:
    found = {(body, NONE, seed): PLAIN for body, seed in product((IN, OUT), (1, 2))}
    found |= {(body, OWN, seed): replace(PLAIN, name=OWN) for body, _, seed in found}
    found[OUT, OWN, 2] = replace(PLAIN, name=OWN, over_time=0.138)
    (worst,) = worst_fingers(found)
    assert (worst.seed, worst.harm.body, worst.harm.fingers) == (2, OUT, 1)
    assert worst.harm.is_out
    assert not any(harm.is_out for harm in harms(found))


@pytest.mark.parametrize("form", LAWS_OF)
def test_a_form_writes_its_table_the_exclusions_and_what_both_files_open_with(
    form: Form, tmp_path: Path
) -> None:
    page, readme = tmp_path / "page.md", tmp_path / "readme.md"
    page.write_text(steady_docs.PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    readme.write_text(steady_opening.README.read_text(encoding="utf-8"), encoding="utf-8")
    much = replace(PLAIN, over_time=9.0)
    found = {(body, NONE, seed): PLAIN for body, seed in product(BodyKind, (1, 2))}
    found |= {(body, CONTACT, seed): replace(much, name=CONTACT) for body, _, seed in found}
    said = steady_bodies.conditions(form, TESTED, 40, 40)
    fingers = worst_fingers(found)
    write_docs(page, readme, form.name, harms(found), said, fingers, KNOWN)
    written = page.read_text(encoding="utf-8")
    of = f"{form.electrodes} electrodes{', unbroken' if form is UNBROKEN else ''}"
    worst = f"from 10 to 900 % with {of} (`{CONTACT}` on `area`)"
    assert worst in " ".join(readme.read_text(encoding="utf-8").split())
    assert f"With {of}: `{CONTACT}`, from 10 to 900 % on `area`" in written
    assert f"- {CONTACT}: 90.00, 1.00, 1.00 on `adapting`, finger 1\n" in written
    assert f"| `{CONTACT}` | not played | `{OUT}` | not played | as it is |" in written
    again = written
    write_docs(page, readme, form.name, harms(found), said, fingers, KNOWN)
    assert page.read_text(encoding="utf-8") == again


def test_what_judges_and_shows_is_no_part_of_what_plays() -> None:
    """Else a word in the docs' writer, or an exclusion, would play the hour anew."""
    names = {path.stem for path in played_by()}
    assert "steady_run" in names
    judging = {"steady_harm", "steady_exclusions", "steady_opening", "steady_docs", "steady_bodies"}
    assert not names & judging
