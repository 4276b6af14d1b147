"""An order of checks that is drawn anew in each run, and can be repeated: none may lean on another.

Owns: the order; a plugin of pytest's. Must not know: what is checked. The plugin that the other
tests have for it imports numpy first, which takes an emulated processor five seconds.
"""

from __future__ import annotations

import random
from itertools import groupby

import pytest

from guest_board import SEED


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of files, and of checks within them: what is made once for a file stays so."""
    chance = random.Random(SEED)
    files = [list(found) for _, found in groupby(items, key=lambda item: item.path)]
    chance.shuffle(files)
    for found in files:
        chance.shuffle(found)
    items[:] = [item for found in files for item in found]
