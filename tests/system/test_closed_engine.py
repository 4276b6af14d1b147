"""A running engine, and another process of its user: the maxima in its memory are out of reach."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from command_rig import CommandRig, command_rig
from intruder import rightless, tried

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        # As a service's user: root's rights pass every door.
        made.before = tuple(rightless())
        yield made


def test_nobody_of_its_user_looks_into_an_engine_or_writes_its_memory(rig: CommandRig) -> None:
    with rig.daemon() as daemon:
        parts = daemon.children()
        found = tried(parts["engine"])
        # The gateway has nothing that a client could not ask for: the attempts can be seen there.
        assert tried(parts["gateway"])["what it has open"] == "done"
    assert len(found) == 7
    assert set(found.values()) <= {"EPERM", "EACCES"}
