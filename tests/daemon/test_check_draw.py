"""`etd check --draw`: what is drawn, what is refused, and that no file is lost."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest

from drawn_svg import Drawing
from etd import cli
from etd.files.resources import find
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

BOARD = (CONFIG / "boards" / "reference-hv507.toml").read_text(encoding="utf-8")


def check(*arguments: str | Path) -> int:
    return cli.main(["check", *map(str, arguments)])


def told(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.parametrize(
    ("text", "more", "kind", "title"),
    [
        (ARRAY, (), "array", "Array strip-3: sheet at 1 : 1"),
        (BOARD, (), "board", "Board reference-hv507: the 40-pin header"),
        (CALIBRATION, ("--array", "strip.toml"), "calibration", "Calibration P01 on strip-3"),
        (PATTERN, ("--array", "strip.toml"), "pattern", "Pattern something on strip-3"),
        (json.dumps(LAYOUT), (), "eTactileKit layout", "Array etactilekit-something"),
        (kit_pattern(kit_frame([1] * 8)), (), "eTactileKit pattern", "Pattern something on pad-8"),
    ],
)
def test_each_kind_has_its_picture(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    text: str,
    more: tuple[str, ...],
    kind: str,
    title: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "strip.toml", ARRAY)
    write(tmp_path, "something", text)
    assert check("--json", "--draw", "out.svg", *more, "something") == 0
    answer = told(capsys)
    drawing = Drawing((tmp_path / "out.svg").read_text(encoding="utf-8"))
    assert str(drawing.root[0].text).startswith(title)
    drawn = answer["drawn"]
    assert isinstance(drawn, dict)
    assert drawn["file"] == "out.svg"
    assert drawn["kind"] == kind
    assert (drawn["width_mm"], drawn["height_mm"]) == (drawing.width, drawing.height)
    assert drawn["summary"] != ""


def test_what_was_drawn_is_told_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    array, out = write(tmp_path, "a.toml", ARRAY), tmp_path / "out.svg"
    assert check("--draw", out, array) == 0
    good, drew = capsys.readouterr().out.splitlines()
    assert good.startswith(f"good  {array}: array strip-3: ")
    assert drew.startswith(f"drew  {out}: 3 electrodes at 1 : 1, seen from the skin and mirrored;")
    assert re.search(r"print it at 100 % \(190 x \d+ mm\)$", drew)


def test_an_answer_without_a_picture_is_as_ever(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check("--json", write(tmp_path, "a.toml", ARRAY)) == 0
    assert sorted(told(capsys)) == ["files", "ok"]


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (DAEMON, "configuration"),
        ((CONFIG / "bodysites" / "fingertip.toml").read_text("utf-8"), "body site"),
        ((CONFIG / "machines" / "pi4.toml").read_text("utf-8"), "machine"),
    ],
)
def test_a_kind_without_a_picture_is_refused_with_the_kinds_that_have_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, kind: str
) -> None:
    path, out = write(tmp_path, "a.toml", text), tmp_path / "out.svg"
    assert check("--draw", out, path) == 1
    sentence = capsys.readouterr().err
    assert f"{path}: there is no picture of a file of this kind ({kind})" in sentence
    assert "array, board, calibration, pattern, eTactileKit layout, eTactileKit pattern" in sentence
    assert not out.exists()


def test_nothing_is_drawn_of_a_file_that_is_not_valid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, "a.toml", spoiled(ARRAY, "diameter_mm", "diametre_mm"))
    out = tmp_path / "out.svg"
    assert check("--draw", out, path) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "nothing is drawn"
    assert check("--json", "--draw", out, path) == 1
    answer = told(capsys)
    assert (answer["ok"], answer["drawn"]) == (False, None)
    assert not out.exists()


def test_an_existing_file_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write(tmp_path, "a.toml", ARRAY), write(tmp_path, "out.svg", "mine")
    assert check("--draw", out, path) == 1
    assert "it exists, and is not overwritten" in capsys.readouterr().err
    assert out.read_text() == "mine"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a.toml", "out.svg"]


def test_a_picture_of_a_person_is_as_private_as_the_calibration(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        write(tmp_path, "strip.toml", ARRAY)
        person = write(tmp_path, "P01.toml", CALIBRATION)
        assert (
            check("--draw", tmp_path / "P01.svg", "--array", tmp_path / "strip.toml", person) == 0
        )
        assert check("--draw", tmp_path / "a.svg", tmp_path / "strip.toml") == 0
    finally:
        os.umask(before)
    assert (tmp_path / "P01.svg").stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "a.svg").stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--draw", "out.svg", "a.toml", "b.toml"), "--draw draws one file, 2 are named"),
        (("--draw", "a.toml", "b.toml"), "pictures are SVG: name a file that ends in .svg"),
        (("--array", "pad-8", "a.toml"), "--array goes with --draw"),
        (("--draw", "out.svg", "--array", "pad-8", "a.toml"), "--array is for a calibration or a"),
    ],
)
def test_wrong_use_is_told_and_nothing_is_written(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "a.toml", ARRAY)
    write(tmp_path, "b.toml", ARRAY)
    with pytest.raises(SystemExit) as caught:
        check(*arguments)
    assert caught.value.code == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out.svg").exists()
    assert (tmp_path / "a.toml").read_text() == ARRAY


def test_a_calibration_needs_the_array_on_which_it_was_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write(tmp_path, "P01.toml", CALIBRATION), tmp_path / "out.svg"
    assert check("--draw", out, path) == 1
    sentence = capsys.readouterr().err
    assert "it was made on 'strip-3', which is no shipped array; name the array's file" in sentence
    assert check("--draw", out, "--array", "pad-8", path) == 1
    sentence = capsys.readouterr().err
    assert "it was made on 'strip-3', and --array names 'pad-8'" in sentence
    assert not out.exists()


def test_a_calibration_with_other_electrodes_than_its_array_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = ARRAY.replace("    { x_mm = 0.0, y_mm = 0.0 },\n", "")
    array = write(tmp_path, "strip.toml", short)
    path = write(tmp_path, "P01.toml", CALIBRATION)
    assert check("--draw", tmp_path / "out.svg", "--array", array, path) == 1
    assert "it is for 3 electrodes, strip-3 has 2" in capsys.readouterr().err


def test_a_shipped_calibration_finds_its_array_by_itself(tmp_path: Path) -> None:
    out = tmp_path / "out.svg"
    assert check("--draw", out, find("calibrations", "fake-fingertip-pad-8")) == 0
    assert "threshold-value-7" in Drawing(out.read_text(encoding="utf-8"))


def test_a_pattern_for_no_shipped_array_needs_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write(tmp_path, "p.json", PATTERN), tmp_path / "out.svg"
    assert check("--draw", out, path) == 1
    assert "no shipped array has 3 electrodes; name an array file with --array" in (
        capsys.readouterr().err
    )
    assert check("--draw", out, "--array", "pad-8", path) == 1
    assert "it is for 3 electrodes, pad-8 has 8" in capsys.readouterr().err


def test_a_pattern_is_drawn_on_a_layout_of_another_kit(tmp_path: Path) -> None:
    layout = write(tmp_path, "l.json", json.dumps(LAYOUT))
    path, out = write(tmp_path, "p.json", PATTERN), tmp_path / "out.svg"
    assert check("--draw", out, "--array", layout, path) == 0
    assert "etactilekit-l" in Drawing(out.read_text(encoding="utf-8")).words()


def test_a_sheet_of_a_layout_says_that_its_side_is_not_known(tmp_path: Path) -> None:
    layout, out = write(tmp_path, "l.json", json.dumps(LAYOUT)), tmp_path / "out.svg"
    assert check("--draw", out, layout) == 0
    words = Drawing(out.read_text(encoding="utf-8")).words().replace("\n", " ")
    assert "Note: a layout does not say from which side it is drawn" in words
    assert "the two sides below are swapped" in words


def test_a_folder_that_is_not_there_is_told_before_anything_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check("--draw", tmp_path / "none" / "out.svg", tmp_path / "none.toml") == 1
    assert f"{tmp_path / 'none'}: there is no such folder; create it first" in (
        capsys.readouterr().err
    )
