"""A board process for tests, and its second door.

Owns: starting and ending the process, and knocking at the door.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from board_door import knock_at
from etd_hal.boardfile import BoardFile
from etd_hal.fake import wire
from stepped_board import BOARDS

HAL = Path(__file__).parent.parent / "hal"
_ANSWERS_WITHIN_S = 120.0


@dataclass(frozen=True, slots=True)
class RunningBoard:
    socket: Path
    door: Path
    trace: Path
    process: subprocess.Popen[bytes]

    def knock(self, knock: wire.Knock) -> wire.State:
        """See `board_door.knock_at`."""
        return knock_at(self.door, knock, _ANSWERS_WITHIN_S)

    def state(self) -> wire.State:
        return self.knock(wire.AskState())


@contextmanager
def running_board(board: BoardFile, folder: Path, *sensors: str) -> Iterator[RunningBoard]:
    """A board process for a shipped board file, with these pressure sensors under its array; ended
    (with its trace closed) at the end.
    """
    places = RunningBoard(
        folder / "board.sock",
        folder / "door.sock",
        folder / "board.trace.jsonl",
        _start(board, folder, sensors),
    )
    try:
        yield places
    finally:
        places.process.terminate()
        places.process.wait(_ANSWERS_WITHIN_S)
        if places.process.stdout is not None:
            places.process.stdout.close()


def _start(board: BoardFile, folder: Path, sensors: tuple[str, ...]) -> subprocess.Popen[bytes]:
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "etd_hal.fake.process"),
            *("--board", str(BOARDS / f"{board.name}.toml")),
            *("--socket", str(folder / "board.sock")),
            *("--door", str(folder / "door.sock")),
            *("--trace", str(folder / "board.trace.jsonl")),
            *(word for sensor in sensors for word in ("--sensor", sensor)),
        ],
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(HAL)},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"listening\n"
    return process
