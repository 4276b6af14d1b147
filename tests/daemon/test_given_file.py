"""A file that a command is given is a regular one: nothing waits at a pipe."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from etd.cli import main
from etd.cli.given_file import check_given
from etd.protocol.errors import FileError


def test_what_can_be_read_to_its_end_is_taken(tmp_path: Path) -> None:
    (tmp_path / "it").write_text("x")
    (tmp_path / "linked").symlink_to("it")
    for path in (tmp_path / "it", tmp_path / "linked", tmp_path / "not there"):
        assert check_given(path) == path


@pytest.mark.parametrize(("make", "why"), [(os.mkfifo, "a pipe"), (os.mkdir, "a folder")])
def test_what_has_no_end_is_refused(tmp_path: Path, make: Callable[[Path], None], why: str) -> None:
    make(tmp_path / "it")
    with pytest.raises(FileError, match=f"it is {why}.*name another"):
        check_given(tmp_path / "it", "name another")


@pytest.mark.parametrize("verb", ["calibration import", "record show", "record csv"])
def test_a_command_does_not_wait_at_a_pipe(
    tmp_path: Path, verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / "P01.toml")
    assert main([*verb.split(), str(tmp_path / "P01.toml")]) != 0
    assert "it is a pipe, a device or a socket" in capsys.readouterr().err
