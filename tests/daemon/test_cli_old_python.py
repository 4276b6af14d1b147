"""The command on a Python that runs the client only: what it refuses, how, and what it lists.

Owns: the refusals, with a version that the interpreter is told to be. Must not know: whether the
client runs there (`tests/test_client_python.py`).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from etd import cli
from etd_hal.errors import PythonTooOld
from etd_hal.tomlfile import read_toml

pytestmark = pytest.mark.usefixtures("on_310")

A_FILE = str(Path(__file__).parents[2] / "config" / "etd.toml")


@pytest.fixture
def on_310(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 10, 13, "final", 0))


@pytest.mark.parametrize("verb", sorted(cli.DAEMON_VERBS))
def test_a_verb_of_the_daemon_refuses_with_a_sentence_before_it_is_imported(
    verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def imported(module: str) -> None:
        raise AssertionError(f"{module} was imported")

    monkeypatch.setattr("importlib.import_module", imported)
    assert cli.main([verb]) == cli.NOT_THERE
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err == (
        f"etd: etd {verb} needs Python 3.11 or newer, and {sys.executable} is Python 3.10, which"
        " runs etd's client only: install 'etd[daemon]' for a newer Python, here or on the computer"
        " with the board\n"
    )


def test_with_json_the_refusal_is_an_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["safe", "--json"]) == cli.NOT_THERE
    answer = json.loads(capsys.readouterr().out)
    assert (answer["ok"], answer["error"]) == (False, "python_too_old")


@pytest.mark.parametrize(
    "words",
    [
        ["play", "wave.json", "--board", "fake"],
        ["calibrate", "P1", "--board", "fake", "--max-current-ua", "900"],
        ["record", "replay", "record.jsonl"],
    ],
    ids=lambda words: words[0],
)
def test_so_does_a_fake_board_of_a_clients_verb(
    words: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    frames = [{"duration_ms": 100, "active": [0]}]
    wave = {"etd_pattern": 1, "electrodes": 1, "frames": frames}
    Path("wave.json").write_text(json.dumps(wave))
    assert cli.main(words) == cli.NOT_THERE
    assert "etd: a fake board needs Python 3.11 or newer" in capsys.readouterr().err


def test_so_does_a_toml_file(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(PythonTooOld) as refused:
        read_toml(Path(A_FILE))
    assert (refused.value.needed, refused.value.found) == ("3.11", "3.10")
    assert cli.main(["calibration", "import", A_FILE]) == cli.NOT_THERE
    assert f"{A_FILE}: reading TOML needs Python 3.11" in capsys.readouterr().err


def test_the_help_lists_the_clients_verbs_and_names_the_others(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    told = capsys.readouterr().out
    firsts = {line.split()[0] for line in told.splitlines() if line.startswith("    ")}
    assert {verb for verb in cli.VERBS if verb in firsts} == set(cli.VERBS) - cli.DAEMON_VERBS
    assert "run, demo, selftest, bench, check, report, explain, safe" in told
