"""A command at a terminal of its own, whose keys a test presses.

Owns: the pseudo-terminal and the process. Must not know: what is judged.
"""

from __future__ import annotations

import os
import pty
import subprocess
import sys

from command_rig import WITHIN_S, Command, CommandRig
from etd.calibrate.order import is_catch

#: Of an order that begins with electrode 0; a calibration at a terminal is to be asked for with it.
SEED = 4


class AtTerminal:
    """A command whose keyboard is a terminal, and whose output is read line by line."""

    def __init__(self, rig: CommandRig, *arguments: str) -> None:
        self._keys, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "etd", *arguments],
            stdin=theirs,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            env=rig.environment,
            cwd=rig.folder,
        )
        os.close(theirs)
        self.command = Command(self.process)
        self._trial = 0

    def answer(self, keys: str) -> None:
        """A key for each question; what is silent is not felt."""
        for key in keys:
            while is_catch(SEED, self._trial):
                self._press("n")
            self._press(key)
            if key == "t":
                self.command.line_with("Too strong. Was it so?", "stdout")
                os.write(self._keys, b"t")

    def _press(self, key: str) -> None:
        self.command.line_with("How strong was it", "stdout")
        os.write(self._keys, key.encode())
        self._trial += 1

    def press(self, key: bytes) -> None:
        os.write(self._keys, key)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate(timeout=WITHIN_S)
        os.close(self._keys)
