"""The chips behind the buses while the contract tests of the ports run on the guest's drivers.

Owns: starting the answerer around them, and naming them the guest's board and machine. A plugin of
pytest's, because `tests/contract` runs elsewhere too. Must not know: what the contract says.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from guest_board import BOARD_PATH, MACHINE_PATH, running_chips


def pytest_configure(config: pytest.Config) -> None:
    config.option.board_file = str(BOARD_PATH)
    config.option.machine_file = str(MACHINE_PATH)


@pytest.fixture(scope="module", autouse=True)
def chips_of_the_contract(request: pytest.FixtureRequest) -> Iterator[None]:
    if request.path.parent.name != "contract":
        yield
        return
    # A Unix socket's path has at most 107 bytes: not in pytest's folder.
    with tempfile.TemporaryDirectory(prefix="rig") as folder, running_chips(Path(folder)):
        yield
