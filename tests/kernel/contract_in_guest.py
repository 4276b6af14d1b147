"""The contract tests of the ports, on the guest's drivers and with the chips behind them.

Owns: starting the answerer around them. Must not know: what the contract says (tests/contract).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pytest

from guest_board import BOARD_PATH, MACHINE_PATH, TREE, running_chips

# A Unix socket's path has at most 107 bytes: not in pytest's folder.
with tempfile.TemporaryDirectory(prefix="rig") as folder, running_chips(Path(folder)):
    status = pytest.main(
        [
            *(str(TREE / "tests/contract"), "-k", "linux", "-p", "no:cacheprovider"),
            *(f"--board-file={BOARD_PATH}", f"--machine-file={MACHINE_PATH}", "--color=no"),
        ]
    )
sys.exit(status)
