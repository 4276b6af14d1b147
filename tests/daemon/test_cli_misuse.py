"""Used wrongly: status 2 for all verbs alike, and JSON for whoever asked for it."""

from __future__ import annotations

import json

import pytest

from etd import cli

WRONG = [
    ["status", "--what"],
    ["selftest", "--array"],
    ["calibration", "show"],
    ["play"],
    ["monitor", "--seconds", "-1"],
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
    assert "error: " in told.err
