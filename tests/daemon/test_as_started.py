"""The copy of a board's file as the engine had it: when it counts; nothing waits for it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from etd.files.as_started import as_started, keep_as_started
from etd.files.paths import board_as_started_file


def test_it_counts_for_its_file_and_for_no_other(tmp_path: Path) -> None:
    board, copy = tmp_path / "board.toml", board_as_started_file("main", "linux", tmp_path)
    board.write_text('name = "edited later"\n', encoding="utf-8")
    keep_as_started(copy, board)
    assert as_started("main", None, tmp_path) == copy
    assert as_started("main", board, tmp_path) == copy
    assert as_started("main", tmp_path / "other.toml", tmp_path) is None


def test_one_that_cannot_be_made_leaves_the_one_before(tmp_path: Path) -> None:
    board, copy = tmp_path / "board.toml", board_as_started_file("main", "linux", tmp_path)
    board.write_text('name = "driven"\n', encoding="utf-8")
    keep_as_started(copy, board)
    before = copy.read_bytes()
    board.unlink()
    with pytest.raises(FileNotFoundError):
        keep_as_started(copy, board)
    assert copy.read_bytes() == before


@pytest.mark.parametrize(
    "head", [b"", b"# etd: {}\n", b"# etd: [1]\n", b"# etd: 1\n", b"\xff\n", b"[" * 5_000 + b"\n"]
)
def test_what_is_no_copy_is_none(head: bytes, tmp_path: Path) -> None:
    copy = board_as_started_file("main", "linux", tmp_path)
    copy.parent.mkdir(parents=True, exist_ok=True)
    copy.write_bytes(head)
    assert as_started("main", None, tmp_path) is None


def test_a_pipe_in_its_place_is_none_at_once(tmp_path: Path) -> None:
    copy = board_as_started_file("main", "linux", tmp_path)
    copy.parent.mkdir(parents=True, exist_ok=True)
    os.mkfifo(copy)
    assert as_started("main", None, tmp_path) is None
