"""What `make bench-calibrate` sits, and what it says where that cannot be."""

from __future__ import annotations

import pytest

from bench import calibrate as bench_calibrate
from bench import calibrate_persons


@pytest.mark.parametrize(
    ("given", "sittings"),
    [
        ("limits", [("limits",)]),
        ("equalize", [("limits", "equalize")]),
        ("staircase", [("staircase",)]),
    ],
)
def test_only_what_was_asked_for_is_sat_and_what_that_begins_with(
    given: str, sittings: list[tuple[str, ...]]
) -> None:
    args = bench_calibrate.arguments(["--skin", "still", "--seeds", "4711", "--method", given])
    assert [job.methods for job in bench_calibrate.jobs(args)] == sittings


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("--electrodes 3 --method equalize", "equalize compares all others with electrode 4"),
        ("--electrodes 4", "equalize compares all others with electrode 4"),
        ("--electrodes 9", "--electrodes 9: pad-8 has 1 to 8"),
        ("--array none", "there is no 'none' among the shipped arrays"),
    ],
)
def test_what_cannot_be_sat_is_told_before_it_begins(
    given: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        bench_calibrate.arguments(["--array", "pad-8", *given.split()])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_a_reference_that_was_not_felt_is_told_in_a_sentence() -> None:
    job = bench_calibrate.Job("pad-8", 1, "still", 4711, ("limits", "equalize"))
    said = bench_calibrate.sit(job)
    assert isinstance(said, str)
    assert "electrode 4 was not felt in the baseline" in said


@pytest.mark.parametrize("person", ["good", "all"])
def test_the_default_holds_its_bounds_with_a_person_who_answers_badly(
    person: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--method", "staircase", "--person", person, "--seeds", "21", "22"]
    assert calibrate_persons.main(given) == 0
    assert "holds" in capsys.readouterr().out


def test_a_method_that_is_not_the_default_has_a_bound_for_pain_only() -> None:
    sitting = calibrate_persons.Sitting(errors=[0.9] * 9, pain=1.0)
    for method, pain, is_held in (
        ("limits", 1.0, True),
        ("limits", 1.2, False),
        ("staircase", 1.0, False),
    ):
        sitting.pain = pain
        assert calibrate_persons.row_of(method, "all", [sitting])["ok"] is is_held  # type: ignore[arg-type]


def test_pain_of_who_says_it_too_late_is_told_and_not_called_held() -> None:
    sitting = calibrate_persons.Sitting(errors=[0.01] * 9, pain=1.2)
    row = calibrate_persons.row_of("staircase", "at pain", [sitting])
    assert row["ok"]
    assert calibrate_persons.line_of(row).endswith("told and not judged")
    sitting.pain = 1.0
    row = calibrate_persons.row_of("staircase", "at pain", [sitting])
    assert calibrate_persons.line_of(row).endswith("of 1: holds")
