"""Used wrongly: status 2 for all verbs alike, and JSON for whoever asked for it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from etd import cli

WRONG = [
    ["status", "--what"],
    ["selftest", "--array"],
    ["calibration", "show"],
    ["play"],
    ["monitor", "--seconds", "-1"],
    ["stop", "--name", "../../etc"],
    ["record", "list", "--name", "a\n"],
]


@pytest.mark.parametrize("arguments", WRONG, ids=lambda entry: entry[0])
def test_a_program_that_asked_for_json_gets_the_reason_as_json(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([*arguments, "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert ended.value.code == 2
    assert (answer["ok"], answer["error"]) == (False, "used_wrongly")
    assert answer["reason"].startswith("etd")


@pytest.mark.parametrize("arguments", WRONG, ids=lambda entry: entry[0])
def test_people_get_it_on_standard_error_alone(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    told = capsys.readouterr()
    assert (ended.value.code, told.out) == (2, "")
    sentence, where = told.err.splitlines()
    assert sentence.startswith("etd ")
    assert "error: " in sentence
    assert "--help` explains" in where


@pytest.mark.parametrize("verb", ["status", "run", "calibration"])
def test_what_was_given_is_told_with_its_escapes_and_cut(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        cli.main([verb, "\x1b[31mfoo\nbar" + 5_000 * "x"])
    told = capsys.readouterr().err
    assert "\\x1b[31mfoo" in told
    assert told.count("\n") == 2
    assert "\x1b" not in told
    assert len(told) < 1_500


@pytest.mark.parametrize("verb", ["run", "play x.json", "demo"])
def test_a_fake_of_no_board_is_not_the_default_one(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([*verb.split(), "--board", "fake:"])
    assert ended.value.code == 2
    assert "names no board after its colon" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("run", "--config", "/dev/zero"), "it is no regular file"),
        (("run", "--board", "fake", "--array", "/dev/zero"), "it is no regular file"),
        (("run", "--board", "fake", "--folder", "/etc/passwd"), "/etc/passwd: this is no folder"),
        (("record", "show", "{file}"), "its 100000 bytes have no line break"),
    ],
    ids=["config", "array", "folder", "record"],
)
def test_what_is_there_is_not_said_to_be_missing(
    arguments: tuple[str, ...], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "big.json"
    file.write_bytes(b"7" * 100_000)
    assert cli.main([given.format(file=file) for given in arguments]) == cli.NO
    said = capsys.readouterr().err
    assert told in said
    assert "there is no such" not in said
    assert "give --folder" not in said
