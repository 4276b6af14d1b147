"""`etd stop` of root, where another user has laid out as many sockets as may be."""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from command_rig import CommandRig, command_rig
from etd.files.paths import MOST_OF_A_USER

pytestmark = pytest.mark.slow
STRANGER = 65_533
SOCKETS = 400


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


@pytest.mark.skipif(os.geteuid() != 0, reason="only root asks daemons of other users")
def test_four_hundred_sockets_of_a_stranger_keep_root_from_nothing(rig: CommandRig) -> None:
    with ExitStack() as stack:
        # Of that user, and within what the path of a socket may have.
        theirs = rig.folder / f"etd-{STRANGER}"
        theirs.mkdir()
        for number in range(SOCKETS):
            folder = theirs / f"a{number}"
            folder.mkdir()
            listening = stack.enter_context(socket.socket(socket.AF_UNIX))
            listening.bind(str(folder / "control.sock"))
            listening.listen()
        os.chown(theirs, STRANGER, STRANGER)
        with rig.daemon("--array", "pad-8"):
            stopped = rig.run("stop", "--json")
            assert rig.run("status", "--json").answer["status"]["state"] == "HALTED"
    answered = [entry for entry in stopped.answer["daemons"] if entry["error"] is None]
    assert [entry["name"] for entry in answered] == ["main"]
    assert len(stopped.answer["daemons"]) == 1 + MOST_OF_A_USER
    assert stopped.answer["daemons"][0]["name"] == "main"
    assert stopped.status == 3
    (told,) = stopped.answer["not_asked"]
    assert str(SOCKETS - MOST_OF_A_USER) in told
    assert tempfile.gettempdir() in told
