"""How far a calibration by the simulated person is: a bar on a terminal, else a line at times."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest

from calibrate_scenes import FOUND, ROW
from etd.calibrate.answers import Presentation
from etd.calibrate.progress import Progress
from etd.cli.calibrate_watch import Watch


@pytest.fixture
def progress() -> Progress:
    return Progress(conditions=ROW, found={0: FOUND}, presentations=40)


@contextmanager
def terminal(
    monkeypatch: pytest.MonkeyPatch, columns: int = 100
) -> Iterator[Callable[[], list[str]]]:
    """Standard error goes to one; what is yielded closes it and tells the lines that were drawn
    there, without colors.
    """
    controller, worker = os.openpty()

    def lines() -> list[str]:
        file.close()
        plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", all_of(controller).decode())
        return [line for line in re.split(r"[\r\n]+", plain) if line]

    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", str(columns))
    with os.fdopen(worker, "w") as file, monkeypatch.context() as here:
        here.setattr(sys, "stderr", file)
        yield lines
    os.close(controller)


def all_of(controller: int) -> bytes:
    """The other side is closed: what it wrote comes in pieces, and then an error."""
    pieces = []
    with suppress(OSError):
        while piece := os.read(controller, 65_536):
            pieces.append(piece)
    return b"".join(pieces)


def play(watch: Watch, progress: Progress) -> None:
    """Three presentations to the second electrode, which is found then."""
    with watch:
        watch.begin(3)
        for _ in range(3):
            progress.presentations += 1
            watch.presented(Presentation(1, 850, 848, begun_ns=0))
        progress.found[1] = FOUND
        watch.found()


def test_without_a_terminal_there_is_a_line_for_each_electrode_and_none_on_standard_output(
    progress: Progress, capsys: pytest.CaptureFixture[str]
) -> None:
    play(Watch(progress), progress)
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines() == [
        "method limits: 3 electrodes to do, at least half a minute each",
        "2 of 4 electrodes, 43 presentations",
    ]


def test_a_terminal_shows_every_presentation_and_how_long_it_takes(
    progress: Progress, monkeypatch: pytest.MonkeyPatch
) -> None:
    with terminal(monkeypatch) as lines:
        play(Watch(progress), progress)
        first, *drawn = lines()
    assert first.startswith("method limits: 3 electrodes to do")
    for count in (40, 41, 42, 43):
        assert any(f"1 of 4 electrodes, {count} presentations" in line for line in drawn)
    assert "2 of 4 electrodes, 43 presentations" in drawn[-1]
    assert re.search(r"0:00:0\d to go", drawn[-1])
    assert not any(figure in "".join(drawn) for figure in ("1111", "2222", "2333"))


def test_the_bar_fits_80_columns_with_many_presentations(
    progress: Progress, monkeypatch: pytest.MonkeyPatch
) -> None:
    progress.presentations = 12_342
    with terminal(monkeypatch, columns=80) as lines:
        play(Watch(progress), progress)
        _, *drawn = lines()
    assert max(map(len, drawn)) <= 80
    assert "2 of 4 electrodes, 12345 presentations" in drawn[-1]
    assert re.search(r"0:00:0\d to go", drawn[-1])
