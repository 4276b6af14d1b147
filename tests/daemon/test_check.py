"""`etd check`: every kind is recognized by content, and what is wrong is one sentence."""

from __future__ import annotations

import argparse
import datetime
import json
from pathlib import Path

import pytest

from etd.cli import check as verb
from etd.files.check import check_file
from files_by_hand import (
    ARRAY,
    CALIBRATION,
    CONFIG,
    DAEMON,
    LAYOUT,
    PATTERN,
    kit_frame,
    kit_pattern,
    spoiled,
    write,
)

NOT_RECOMMENDED = "NOT recommended (harm on some modelled bodies, docs/stabilization.md)"
SHIPPED = sorted(CONFIG.rglob("*.toml"))
KIND_OF_FOLDER = {
    "arrays": "array",
    "boards": "board",
    "bodysites": "body site",
    "calibrations": "calibration",
    "config": "configuration",
    "machines": "machine",
}


def run(*arguments: str | Path) -> int:
    parser = argparse.ArgumentParser()
    verb.add_arguments(parser)
    return verb.run(parser.parse_args([str(argument) for argument in arguments]))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_every_shipped_file_is_recognized_and_holds_together(path: Path) -> None:
    checked = check_file(path)
    assert checked.error is None
    assert checked.kind == KIND_OF_FOLDER[path.parent.name]
    assert checked.summary != ""


@pytest.mark.parametrize(
    ("kind", "text", "summary"),
    [
        ("array", ARRAY, "3 electrodes of 1 mm, 2 mm apart, outputs up to 7"),
        ("calibration", CALIBRATION, "3 electrodes of strip-3 on the fingertip, anodic"),
        ("configuration", DAEMON, "kajimoto-hv507 with grid-8x8 on the fingertip (fake); arming"),
        ("pattern", PATTERN, "2 frames for 3 electrodes, 0.075 s, up to 2 active"),
        ("eTactileKit pattern", kit_pattern(kit_frame([1, 1])), "1 frames for 2 electrodes"),
        ("eTactileKit layout", json.dumps(LAYOUT), "3 electrodes of 1.5 mm"),
    ],
)
def test_a_kind_is_known_by_content_whatever_the_file_is_called(
    tmp_path: Path, kind: str, text: str, summary: str
) -> None:
    checked = check_file(write(tmp_path, "something", text))
    assert checked.error is None
    assert checked.kind == kind
    assert summary in checked.summary


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ("", "stabilized by nothing"),
        ("probe_first = true", "stabilized by nothing; a probe before every pulse"),
        (
            'order = ["pressure", "energy", "contact"]\n'
            "[stabilize.contact]\n[stabilize.energy]\n[stabilize.pressure]",
            f"stabilized by pressure, energy, contact; energy and contact {NOT_RECOMMENDED};"
            " contact stands BEHIND pressure and energy: put it before, for they reckon with what"
            " it leaves",
        ),
        (
            'order = ["strength_duration", "contact", "linear_law"]\n[stabilize.contact]\n'
            "[stabilize.linear_law]\n"
            "[stabilize.strength_duration]\nwidth_us = 50\ntau_us = 150.0",
            "stabilized by strength_duration, contact, linear_law; contact and linear_law"
            f" {NOT_RECOMMENDED}",
        ),
        (
            'order = ["power_law"]\n[stabilize.power_law]',
            f"stabilized by power_law; power_law {NOT_RECOMMENDED}; power_law only for a person"
            " with a k (etd calibrate CODE --fit)",
        ),
        (
            'order = ["contact", "energy"]\nprobe_first = true\n'
            "[stabilize.contact]\n[stabilize.energy]\n"
            "[stabilize.bursts]\npulses = 2\nrate_hz = 350.0",
            f"stabilized by contact, energy; contact and energy {NOT_RECOMMENDED}; a probe before"
            " every pulse; bursts of 2 at 350 Hz",
        ),
    ],
)
def test_what_is_in_force_at_a_body_site_is_named(tmp_path: Path, table: str, told: str) -> None:
    site = (CONFIG / "bodysites" / "fingertip.toml").read_text(encoding="utf-8")
    checked = check_file(write(tmp_path, "a.toml", f"{site}\n[stabilize]\n{table}\n"))
    assert checked.error is None
    assert checked.summary.endswith(f"for 1 mm; {told}")


def test_it_is_told_where_the_persons_word_may_raise(tmp_path: Path) -> None:
    site = (CONFIG / "bodysites" / "fingertip.toml").read_text(encoding="utf-8")
    assert "RAISE" not in check_file(write(tmp_path, "a.toml", site)).summary
    site = site.replace("felt_may_raise = false", "felt_may_raise = true")
    assert f"word of a person who feels less in use may RAISE levels, {NOT_RECOMMENDED}" in (
        check_file(write(tmp_path, "b.toml", site)).summary
    )


def test_it_is_told_where_frames_get_both_phases(tmp_path: Path) -> None:
    site = (CONFIG / "bodysites" / "fingertip.toml").read_text(encoding="utf-8")
    assert "BOTH phases" not in check_file(write(tmp_path, "a.toml", site)).summary
    balances = site.replace("felt_may_raise", 'balance = "biphasic"\nfelt_may_raise')
    assert "get BOTH phases" in check_file(write(tmp_path, "b.toml", balances)).summary
    spoiled_site = site.replace("felt_may_raise", "balance = true\nfelt_may_raise")
    assert "balance" in str(check_file(write(tmp_path, "c.toml", spoiled_site)).error)


def test_a_byte_order_mark_before_the_text_does_not_hide_the_kind(tmp_path: Path) -> None:
    assert check_file(write(tmp_path, "something", "\ufeff" + PATTERN)).kind == "pattern"


def test_one_key_of_its_own_is_enough_to_know_a_kind(tmp_path: Path) -> None:
    checked = check_file(write(tmp_path, "a.toml", 'backend = "fake"'))
    assert checked.kind == "configuration"
    assert "missing required field" in str(checked.error)


def test_a_file_with_a_typo_is_still_known_for_what_it_is(tmp_path: Path) -> None:
    checked = check_file(write(tmp_path, "a.toml", spoiled(ARRAY, "diameter_mm", "diametre_mm")))
    assert checked.kind == "array"
    assert checked.error is not None
    assert "unknown field `diametre_mm`" in checked.error


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("a.toml", 'color = "red"\n', "its keys are those of no kind of file (color)"),
        ("a.toml", "", "its keys are those of no kind of file (it has none)"),
        ("a.toml", "x = = 1", "it is not TOML"),
        ("a.toml", f"x = {'[' * 5_000}", "it is nested too deep"),
        ("a.json", '{"x": 1}', "it is no kind of JSON file"),
        ("a.json", "{", "it is not JSON"),
    ],
)
def test_a_file_of_no_kind_is_refused_with_a_sentence(
    tmp_path: Path, name: str, text: str, sentence: str
) -> None:
    path = write(tmp_path, name, text)
    checked = check_file(path)
    assert checked.error is not None
    assert checked.error.startswith(f"{path}: ")
    assert sentence in checked.error


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    for name in ("a.toml", "a.json"):
        path = tmp_path / name
        path.write_bytes(b"\xff\xfe\x00")
        assert "it cannot be read" in str(check_file(path).error)


def test_a_calibration_with_too_few_electrodes_for_a_shipped_array_is_refused(
    tmp_path: Path,
) -> None:
    path = write(tmp_path, "c.toml", spoiled(CALIBRATION, "strip-3", "grid-8x8"))
    assert "3 electrodes, grid-8x8 has 64" in str(check_file(path).error)


def test_a_body_site_beyond_the_yardstick_says_so(tmp_path: Path) -> None:
    text = (CONFIG / "bodysites" / "fingertip.toml").read_text(encoding="utf-8")
    path = write(tmp_path, "s.toml", spoiled(text, "charge_nc = 500", "charge_nc = 900"))
    assert "900 nC a phase, BEYOND the yardstick of about 500 nC" in check_file(path).summary


def test_good_files_are_told_in_a_line_each_and_the_answer_is_yes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    array = write(tmp_path, "a.toml", ARRAY)
    pattern = write(tmp_path, "p.json", PATTERN)
    assert run(array, pattern) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"good  {array}: array strip-3: ")
    assert lines[1].startswith(f"good  {pattern}: pattern p: ")


def test_one_bad_file_makes_the_answer_no_and_the_others_are_still_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "none.toml"
    assert run(missing, write(tmp_path, "a.toml", ARRAY)) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"BAD   {missing}: there is no such file; name one that exists"
    assert lines[1].startswith("good  ")


def test_what_was_mended_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = spoiled(json.dumps(LAYOUT), "0.75}", "0.75,}")
    assert run(write(tmp_path, "l.json", text)) == 0
    out = capsys.readouterr().out
    assert "\n      mended: line 1: a comma before a closing bracket was left out\n" in out


def test_the_same_is_told_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = write(tmp_path, "a.toml", ARRAY), tmp_path / "none.toml"
    assert run("--json", good, bad) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] is False
    assert [entry["error"] is None for entry in answer["files"]] == [True, False]
    assert answer["files"][0]["kind"] == "array"


def test_no_file_at_all_is_wrong_use(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run()
    assert caught.value.code == 2
    assert "FILE" in capsys.readouterr().err


def test_whether_one_lease_can_have_two_calibrations_is_told_before_it_is_opened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    anodic = write(tmp_path, "a.toml", CALIBRATION)
    cathodic = write(tmp_path, "c.toml", CALIBRATION.replace('"anodic"', '"cathodic"'))
    assert run("--together", anodic, cathodic) == 0
    assert "one lease can have them" in capsys.readouterr().out
    assert run("--together", anodic, anodic) == 1
    assert "BAD   two calibrations of one lease" in capsys.readouterr().out
    assert run("--together", "--json", anodic, cathodic) == 0
    assert json.loads(capsys.readouterr().out)["together"] == ""


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("", "", "k = 0.70 for power_law on kajimoto-hv507 (66000 ohm)"),
        ("fold = 3.0", "fold = 1.1", "is not for this person: k = 0.70 is of a skin whose resi"),
        ("0, 1, 2, 3", "0, 1, 2", "power_law is not for this person: k = 0.70 is of 3 electrodes"),
        ("explained_of_all = 0.8,", "", "before it was kept how much it explains of all"),
        ("high = 0.8", "high = 50.0", "ends further from k than zero"),
        ("2025-01-15", "1990-01-01", "not for this person: k = 0.70 is of 1990-01-01, before the"),
        (
            "2025-01-15",
            "2099-01-01",
            "ohm), in doubt: k = 0.70 is of 2099-01-01, and today is 2026",
        ),
        ("low = 0.6", "low = -0.6", "has zero in it"),
        (', board = "kajimoto-hv507"', "", "was measured before its board was kept with it"),
    ],
)
def test_whether_a_k_may_be_used_is_told_of_a_calibration(
    tmp_path: Path, old: str, new: str, told: str
) -> None:
    k = (
        "exponent = { k = 0.7, low = 0.6, high = 0.8, explained = 0.9, explained_of_all = 0.8,"
        " electrodes = [0, 1, 2, 3],"
        ' states = 5, fold = 3.0, date = 2025-01-15, board = "kajimoto-hv507", leak_ohm = 66000 }'
    )
    electrode = "    { threshold_ua = 900, comfortable_ua = 1800, cap_ua = 3000 },\n"
    text = spoiled(CALIBRATION, electrode, electrode * 2)
    path = write(tmp_path, "a.toml", k.replace(old, new) + "\n" + text)
    checked = check_file(path, datetime.date(2026, 1, 15))
    assert checked.error is None
    assert told in checked.summary


@pytest.mark.parametrize(
    ("date", "told"),
    [
        ("2026-01-15", "at a body site that allows it (felt_may_raise)"),
        ("2099-01-01", "--adaptation), in doubt: in the second half of 600"),
        ("1990-01-01", "the person's word raises nothing: in the second half of 600 s of use"),
    ],
)
def test_what_the_engine_makes_of_a_measured_adaptation_is_told(
    tmp_path: Path, date: str, told: str
) -> None:
    measured = f"{{ answers = 20, weaker = 16, stronger = 1, use_s = 600.0, date = {date} }}"
    path = write(tmp_path, "a.toml", f"adaptation = {measured}\n{CALIBRATION}")
    checked = check_file(path, datetime.date(2026, 1, 15))
    assert checked.error is None
    assert told in checked.summary
    assert ("in doubt" in checked.summary) == (date > "2026-01-15")
    assert (f"it is of {date}" in checked.summary) == (date != "2026-01-15")


def test_a_calibration_without_a_k_is_told_to_have_none(tmp_path: Path) -> None:
    assert check_file(write(tmp_path, "a.toml", CALIBRATION)).summary.endswith("; no k")
