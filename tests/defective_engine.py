"""An engine on a fake board with a defect in it: `python defective_engine.py FOLDER BOARD`.

Owns: when the defect shows, which is once, as soon as FOLDER has a file `defect`. Must not know:
what the engine does then, who drives it. Beside that it is what `etd run --part engine` runs.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from pathlib import Path

from etd.cli.part_ending import status_of_part
from etd.engine.process import run_engine
from etd.files.configuration import fake_config
from etd_hal.compose import open_fake
from etd_hal.ports import Changes, Edge, Gpio

#: In the folder: the defect shows now; the note of the supply, where `etd run` keeps it.
DEFECT, NOTE = "defect", "state/supply-fake.json"


class DefectiveLines:
    """What no caller expects of lines, once."""

    def __init__(self, gpio: Gpio, asked: Path) -> None:
        self._gpio = gpio
        self._asked = asked

    def _may_show(self) -> None:
        if self._asked.exists():
            self._asked.unlink()
            raise IndexError("the defect")

    def set(self, changes: Changes) -> None:
        self._gpio.set(changes)

    def get(self, line: int) -> int:
        self._may_show()
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        self._may_show()
        return self._gpio.edges()


def main(folder: Path, board: str) -> int:
    loaded = fake_config(board)
    outputs = loaded.array.outputs()
    backend = open_fake(loaded.board, electrodes=outputs, timeout_factor=10)
    lines = DefectiveLines(backend.gpio, folder / DEFECT)
    note = folder / NOTE
    note.parent.mkdir(mode=0o700, exist_ok=True)
    return status_of_part(
        lambda on_ready: run_engine(
            loaded,
            dataclasses.replace(backend, gpio=lines),
            folder,
            folder / "selftest.json",
            on_ready,
            supply_note=note,
        )
    )


if __name__ == "__main__":
    os.umask(0o077)
    sys.exit(main(Path(sys.argv[1]), sys.argv[2]))
