"""What systemd hears."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from etd.engine.notify import Notifier


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[socket.socket]:
    """The listening end, as PID 1 has it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.setblocking(False)
        yield listening


def environment(systemd: socket.socket, **more: str) -> dict[str, str]:
    return {"NOTIFY_SOCKET": systemd.getsockname(), **more}


def test_ready_alive_and_stopping_are_datagrams(systemd: socket.socket) -> None:
    notifier = Notifier(environment(systemd))
    notifier.ready("SAFE, 64 electrodes")
    notifier.alive()
    notifier.stopping()
    heard = [systemd.recv(4096) for _ in range(3)]
    assert heard == [
        b"READY=1\nSTATUS=SAFE, 64 electrodes",
        b"WATCHDOG=1",
        b"STOPPING=1",
    ]
    notifier.close()


def test_an_abstract_address_is_understood() -> None:
    name = f"\0etd-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(name)
        listening.setblocking(False)
        notifier = Notifier({"NOTIFY_SOCKET": "@" + name[1:]})
        notifier.alive()
        assert listening.recv(4096) == b"WATCHDOG=1"
        notifier.close()


def test_without_systemd_nothing_happens() -> None:
    notifier = Notifier({})
    notifier.ready("SAFE")
    notifier.alive()
    assert notifier.undelivered == 0
    assert notifier.watchdog_ns is None


def test_a_listener_that_takes_nothing_never_blocks_and_is_counted(systemd: socket.socket) -> None:
    notifier = Notifier(environment(systemd))
    for _ in range(5000):
        notifier.alive()
    assert notifier.undelivered > 0
    notifier.close()


def test_the_watchdogs_period_is_told_in_nanoseconds_to_the_watched_process_only(
    systemd: socket.socket,
) -> None:
    mine, others = str(os.getpid()), str(os.getpid() + 1)
    for pid, period_ns in ((mine, 500_000_000), (others, None)):
        told = environment(systemd, WATCHDOG_USEC="500000", WATCHDOG_PID=pid)
        notifier = Notifier(told)
        assert notifier.watchdog_ns == period_ns
        notifier.close()
