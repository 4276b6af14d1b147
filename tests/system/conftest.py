"""For tests that start processes: the rigs of tests before are collected first.

What ends in a cycle holds its descriptors until then, and a worker that holds a thousand hands
on numbers that no `select` takes.
"""

from __future__ import annotations

import gc

import pytest


@pytest.fixture(autouse=True, scope="module")
def collected() -> None:
    gc.collect()
