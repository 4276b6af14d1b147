"""`etd record` and `etd report --record` on files: which file, what is written, what is told."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from etd.cli import main
from etd.files.configuration import fake_config
from etd.record import lines
from etd.record.lines import Line
from record_rows import BEGINNING, END, frame, pulse, stored
from scripted_engine import engine_hello

Command = Callable[..., tuple[int, str, str]]
FIRED: tuple[Line, ...] = (
    frame(1, 1, 100, level=[0.5, 0.0, 0.0, 0.4], width_us=60),
    lines.Pulses(rows=(pulse(110, 0, 1, 900), pulse(120, 3, 1, 3_000), pulse(130, 0, 1, 900))),
)


@pytest.fixture
def etd(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Command:
    """In a folder of its own, where no daemon runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    def run(*words: str) -> tuple[int, str, str]:
        try:
            status = main(words)
        except SystemExit as ended:
            status = int(ended.code or 0)
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


@pytest.mark.parametrize("given", ["./plain", "plain.txt", "folder/plain"])
@pytest.mark.parametrize("words", [("record", "show"), ("report", "--board", "fake", "--record")])
def test_what_has_a_separator_or_a_suffix_is_a_file(
    etd: Command, tmp_path: Path, given: str, words: tuple[str, ...]
) -> None:
    (tmp_path / "folder").mkdir()
    stored(tmp_path, *BEGINNING, *FIRED, END).rename(tmp_path / given)
    status, out, err = etd(*words, given)
    assert (status, err) == (0, "")
    assert "p01" in out


@pytest.mark.parametrize("words", [("record", "show"), ("report", "--board", "fake", "--record")])
def test_all_else_is_a_name_that_the_daemon_is_asked_for(
    etd: Command, tmp_path: Path, words: tuple[str, ...]
) -> None:
    stored(tmp_path, *BEGINNING, *FIRED, END).rename(tmp_path / "plain")
    status, _, err = etd(*words, "plain")
    assert status == 3
    assert "is the daemon running?" in err


@pytest.mark.parametrize("words", [("record", "show"), ("record", "csv"), ("report",)])
def test_the_help_has_the_rule(etd: Command, words: tuple[str, ...]) -> None:
    _, out, _ = etd(*words, "--help")
    assert "a separator or a suffix" in " ".join(out.split())


@pytest.mark.parametrize("verb", ["show", "csv"])
def test_an_empty_file_is_no_record(etd: Command, tmp_path: Path, verb: str) -> None:
    stored(tmp_path)
    status, out, err = etd("record", verb, "p01.jsonl")
    assert (status, out) == (1, "")
    assert "nothing was recorded" in err
    assert etd("report", "--board", "fake", "--record", "p01.jsonl")[0] == 1


@pytest.mark.parametrize("out", ["events.json", "events.csv", "events"])
def test_a_table_that_its_own_sidecar_would_replace_is_not_written(
    etd: Command, tmp_path: Path, out: str
) -> None:
    stored(tmp_path, *BEGINNING, *FIRED, END)
    status, _, err = etd("record", "csv", "p01.jsonl", "--out", out)
    assert status == 2
    assert "ends in .tsv" in err
    assert [path.name for path in tmp_path.iterdir()] == ["p01.jsonl"]


def test_a_table_and_its_sidecar_stand_side_by_side(etd: Command, tmp_path: Path) -> None:
    stored(tmp_path, *BEGINNING, *FIRED, END)
    status, _, err = etd("record", "csv", "p01.jsonl", "--out", "events.tsv")
    assert (status, err) == (0, "")
    columns = (tmp_path / "events.tsv").read_text("utf-8").splitlines()[0].split("\t")
    assert list(json.loads((tmp_path / "events.json").read_text("utf-8"))) == columns


CUT_OFF: tuple[Line, ...] = (*BEGINNING, *FIRED)
LOST: tuple[Line, ...] = (*BEGINNING, lines.Lost(t_ns=5, pulses=7, lines=2), *FIRED, END)
FULL: tuple[Line, ...] = (*BEGINNING, *FIRED, lines.End(t_ns=9, why="full"))


@pytest.mark.parametrize(
    ("record", "what"),
    [(CUT_OFF, "cut off"), (LOST, "7 pulses and 2 lines were lost"), (FULL, "was full")],
)
def test_what_a_record_lacks_is_told_wherever_something_is_made_of_it(
    etd: Command, tmp_path: Path, record: tuple[Line, ...], what: str
) -> None:
    stored(tmp_path, *record)
    assert what in etd("record", "csv", "p01.jsonl")[2]
    status, _, err = etd("record", "csv", "p01.jsonl", "--out", "events.tsv")
    assert status == 0
    assert what in err
    sidecar = json.loads((tmp_path / "events.json").read_text("utf-8"))
    assert any(what in sentence for sentence in sidecar["RecordIncomplete"])
    assert what in etd("record", "pattern", "p01.jsonl", "again.json")[2]
    report = ("report", "--board", "fake", "--record", "p01.jsonl")
    assert what in etd(*report)[1]
    assert what in etd(*report, "--methods")[1]
    assert what in etd(*report, "--json")[1]
    assert what in etd(*report, "--html", "report.html")[2]
    assert what in (tmp_path / "report.html").read_text("utf-8")


def test_a_pattern_of_the_chosen_stimuli_says_what_it_leaves_out(
    etd: Command, tmp_path: Path
) -> None:
    current = frame(2, 2, 500, current_ua=[0, 800, 0, 0])
    stored(tmp_path, *BEGINNING, *FIRED, current, lines.Pulses(rows=(pulse(510, 1, 2, 800),)), END)
    status, _, err = etd("record", "pattern", "p01.jsonl", "made.json")
    assert status == 1
    assert "choose which: --of levels, or --of currents" in err
    assert not (tmp_path / "made.json").exists()
    status, _, err = etd("record", "pattern", "p01.jsonl", "made.json", "--of", "levels")
    assert status == 0
    assert "left out: width_us of 1 stimuli" in err
    assert "left out: 1 stimuli of the other kind" in err
    status, out, err = etd(
        "record", "pattern", "p01.jsonl", "more.json", "--of", "currents", "--json"
    )
    assert (status, err) == (0, "")
    assert json.loads(out)["full_ua"] == 800
    assert len(json.loads(out)["left_out"]) == 1


def reported(etd: Command, *words: str) -> Any:
    status, out, err = etd("report", "--board", "fake", "--record", "p01.jsonl", *words)
    assert (status, err) == (0, "")
    return out


def test_the_paragraph_has_the_most_of_each_not_of_one_electrode(
    etd: Command, tmp_path: Path
) -> None:
    """Electrode 3 had most charge (300 nC in a pulse), electrode 0 most pulses (2, of 90 nC)."""
    stored(tmp_path, *BEGINNING, *FIRED, END)
    paragraph = reported(etd, "--methods")
    assert "more than 2 pulses, nor more than 0.3 uC" in paragraph
    assert "3.00 mA" in paragraph


def test_a_record_made_with_the_reported_files_is_said_to_be(etd: Command, tmp_path: Path) -> None:
    facts = engine_hello()
    digests = fake_config().digests
    engine = lines.Engine(t_ns=1, facts=msgspec.structs.replace(facts, digests=digests))
    stored(tmp_path, *BEGINNING[:2], engine, BEGINNING[3], *FIRED, END)
    assert "made with the files above" in reported(etd)
    assert json.loads(reported(etd, "--json"))["record_differs"] == []


def test_a_record_made_with_other_files_is_said_to_be_and_which(
    etd: Command, tmp_path: Path
) -> None:
    facts = engine_hello()
    digests = {**fake_config().digests, "array": "0" * 64}
    engine = lines.Engine(t_ns=1, facts=msgspec.structs.replace(facts, digests=digests))
    stored(tmp_path, *BEGINNING[:2], engine, BEGINNING[3], *FIRED, END)
    (sentence,) = json.loads(reported(etd, "--json"))["record_differs"]
    assert sentence.startswith("the array file is not that of the record, row-4 then and grid-8x8")
    assert "SHA-256 000000000000..." in sentence
    assert sentence in reported(etd)
    assert sentence in reported(etd, "--methods")


def test_a_record_of_another_backend_is_said_to_be(etd: Command, tmp_path: Path) -> None:
    engine = lines.Engine(t_ns=1, facts=engine_hello("linux"))
    stored(tmp_path, *BEGINNING[:2], engine, BEGINNING[3], *FIRED, END)
    assert "the backend was linux, and is fake here" in reported(etd)
