"""`etd stop` of root, where another user has laid out as many sockets as may be."""

from __future__ import annotations

import json
import os
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import pytest
import zmq

from command_rig import CommandRig, command_rig
from etd.client.stopping import stop_at
from etd.files.paths import MOST_OF_A_USER
from etd.protocol.errors import DaemonGone
from etd.protocol.zmtp import GREETING, ready

pytestmark = pytest.mark.slow
STRANGER = 65_533
SOCKETS = 400


class Stopping(threading.Thread):
    """A daemon, as far as `etd stop` can tell: it answers each request that all is well, or what
    it is given.
    """

    def __init__(self, folder: Path, answer: bytes | None = None) -> None:
        super().__init__()
        self._answer = answer
        self._context = zmq.Context()
        self._router = self._context.socket(zmq.ROUTER)
        self._router.bind(f"ipc://{folder / 'control.sock'}")
        self._ending = threading.Event()
        self.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self.join()
        self._context.destroy(linger=0)

    def run(self) -> None:
        while not self._ending.is_set():
            if self._router.poll(50):
                *route, data = self._router.recv_multipart()
                said = {"ok": True, "now_ns": 1, "id": json.loads(data).get("id")}
                answer = self._answer or json.dumps(said).encode()
                self._router.send_multipart([*route, answer])


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
    assert f"not asked: {SOCKETS - MOST_OF_A_USER};" in told
    assert str(theirs) in told


@pytest.mark.skipif(os.geteuid() != 0, reason="only root asks daemons of other users")
def test_where_somebody_was_not_asked_the_status_and_a_sentence_say_so(rig: CommandRig) -> None:
    """All that were asked have stopped: it is no success for those that were not."""
    theirs = rig.folder / f"etd-{STRANGER}"
    with ExitStack() as stack:
        for number in range(MOST_OF_A_USER + 1):
            folder = theirs / f"a{number}"
            folder.mkdir(parents=True)
            stack.enter_context(Stopping(folder))
        os.chown(theirs, STRANGER, STRANGER)
        said, in_json = rig.run("stop"), rig.run("stop", "--json")
    assert said.status == in_json.status == 3
    assert in_json.answer["ok"] is False
    assert all(entry["error"] is None for entry in in_json.answer["daemons"])
    assert f"NOT STOPPED: sockets of the user {STRANGER} that were not asked: 1;" in said.err
    assert f"`etd stop --folder {theirs}/a8`" in said.err


@pytest.mark.skipif(os.geteuid() != 0, reason="only root asks daemons of other users")
@pytest.mark.parametrize(
    "answer", [b" ", b"[]", b"{", b'{"ok":true,"id":1}', b'{"ok":false,"id":1}', b"[" * 60_000]
)
def test_what_answers_as_no_daemon_does_hides_nothing_of_the_others(
    rig: CommandRig, answer: bytes
) -> None:
    with ExitStack() as stack:
        for uid, says in ((STRANGER - 1, answer), (STRANGER, None)):
            folder = rig.folder / f"etd-{uid}" / f"of{uid}"
            folder.mkdir(parents=True)
            stack.enter_context(Stopping(folder, says))
            os.chown(folder.parent, uid, uid)
        said = rig.run("stop")
    assert said.status == 3
    assert f"of{STRANGER}: silent, HALTED" in said.out
    assert f"of{STRANGER - 1}: NOT STOPPED" in said.out
    assert "Traceback" not in said.err


class Endless(threading.Thread):
    """Greets as a daemon does, and sends one message that never ends, as fast as it is read."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(str(folder / "control.sock"))
        self._listening.listen()
        #: Of what was read of it.
        self.sent_bytes = 0
        self.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listening.shutdown(socket.SHUT_RDWR)
        self.join()
        self._listening.close()

    def run(self) -> None:
        part = b"\x01\xff" + bytes(255)
        while True:
            try:
                connection, _ = self._listening.accept()
            except OSError:
                return
            try:
                connection.sendall(GREETING)
                connection.recv(64)
                connection.sendall(ready(b"ROUTER"))
                while True:
                    self.sent_bytes += connection.send(1_000 * part)
            except OSError:
                connection.close()


def test_a_message_that_never_ends_is_not_kept(tmp_path: Path) -> None:
    with Endless(tmp_path) as endless:
        address = f"ipc://{tmp_path / 'control.sock'}"
        with pytest.raises(DaemonGone, match=r"no daemon.s \(a message that is too long\)"):
            stop_at("x", host=None, address=address, client="etd stop", timeout_s=5.0)
    assert endless.sent_bytes < 1_000_000


def test_a_queue_that_is_full_is_tried_again_until_the_time_is_over(tmp_path: Path) -> None:
    control = tmp_path / "control.sock"
    with ExitStack() as stack:
        listening = stack.enter_context(socket.socket(socket.AF_UNIX))
        listening.bind(str(control))
        listening.listen(0)
        waiting = stack.enter_context(socket.socket(socket.AF_UNIX))
        waiting.connect(str(control))
        with pytest.raises(DaemonGone, match=r"no answer to stop within 0\.2 s"):
            stop_at("x", host=None, address=f"ipc://{control}", client="etd stop", timeout_s=0.2)


@pytest.mark.parametrize("reads", [False, True], ids=["reset", "closed"])
def test_a_daemon_that_hangs_up_and_is_there_again_hears_it(tmp_path: Path, reads: bool) -> None:
    control = tmp_path / "control.sock"
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(control))
    listening.listen()
    with ThreadPoolExecutor(1) as pool, ExitStack() as stack:
        asked = pool.submit(
            stop_at, "x", host=None, address=f"ipc://{control}", client="etd stop", timeout_s=30.0
        )
        # The first one only looks whether it listens.
        listening.accept()[0].close()
        connection, _ = listening.accept()
        listening.close()
        control.unlink()
        if reads:
            connection.recv(64)
        connection.close()
        stack.enter_context(Stopping(tmp_path))
        assert asked.result() is None
