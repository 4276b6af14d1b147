"""The comparison of two recordings: it sees a changed byte, a changed report, and applies names."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from scenes import compare

TRACE, TOLD = '{"t_ns": 1}\n', '{"type": "Answer", "slowed": [], "reason": "too fast"}\n'


def recording(folder: Path, trace: str = TRACE, told: str = TOLD) -> Path:
    folder.mkdir()
    (folder / "one.trace.jsonl").write_text(trace, encoding="utf-8")
    (folder / "one.told.jsonl").write_text(told, encoding="utf-8")
    return folder


def status(monkeypatch: pytest.MonkeyPatch, old: Path, new: Path) -> int:
    monkeypatch.setattr(sys, "argv", ["compare.py", str(old), str(new)])
    return compare.main()


def test_equal_recordings_are_equal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old, new = recording(tmp_path / "old"), recording(tmp_path / "new")
    assert status(monkeypatch, old, new) == 0


def test_no_recording_equals_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "empty").mkdir()
    assert status(monkeypatch, tmp_path / "empty", tmp_path / "empty") == 1


@pytest.mark.parametrize(
    ("trace", "told"),
    [
        ('{"t_ns": 2}\n', TOLD),
        (TRACE * 2, TOLD),
        (TRACE, TOLD.replace("[]", "[1]")),
        (TRACE, ""),
    ],
)
def test_what_changed_is_told(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    trace: str,
    told: str,
) -> None:
    old, new = recording(tmp_path / "old"), recording(tmp_path / "new", trace, told)
    assert status(monkeypatch, old, new) == 1
    assert "1 scenes, 1 differences" in capsys.readouterr().out


def test_old_names_are_read_as_new_ones() -> None:
    names = compare.Names({"keys": {"thinned": "slowed"}, "values": {"opening": "soft_start"}})
    assert names.renamed({"thinned": [{"reason": "opening"}]}) == {
        "slowed": [{"reason": "soft_start"}]
    }


def test_a_key_may_be_called_otherwise_below_another_one() -> None:
    names = compare.Names({"keys": {"thinned": "slowed"}, "in": {"scan": {"thinned": "not_fired"}}})
    assert names.renamed({"thinned": 1, "scan": {"thinned": 2}}) == {
        "slowed": 1,
        "scan": {"not_fired": 2},
    }


def test_a_sentence_may_be_worded_otherwise_and_may_not_go() -> None:
    names = compare.Names({"sentences": ["reason"]})
    was, now, gone = ({"reason": text} for text in ("too fast", "does not fit", ""))
    assert names.without_sentences(was) == names.without_sentences(now)
    assert names.without_sentences(was) != names.without_sentences(gone)
