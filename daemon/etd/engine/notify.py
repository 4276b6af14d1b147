"""The messages of a service to systemd: ready, alive, stopping, and a line of status.

Owns: the datagrams of sd_notify(3). Must not know: when to send which, or what time it is.

Never blocks: the scan loop feeds the watchdog. Without systemd every call does nothing.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping


class Notifier:
    """One service's socket to systemd. Field: `undelivered`, datagrams that were dropped."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        # "@" stands for the NUL byte that begins an abstract address.
        self._address = address.replace("@", "\0", 1) if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if address else None
        self.undelivered = 0
        self.watchdog_ns = _watchdog_ns(environment) if address else None

    def ready(self, status: str) -> None:
        self._send(f"READY=1\nSTATUS={status}")

    def alive(self) -> None:
        """Feed the watchdog: at least twice in `watchdog_ns` (None: there is no watchdog)."""
        self._send("WATCHDOG=1")

    def stopping(self) -> None:
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(text.encode(), socket.MSG_DONTWAIT, self._address)
        except OSError:
            # If no other one is delivered in time, the watchdog acts.
            self.undelivered += 1

    def close(self) -> None:
        """Idempotent."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _watchdog_ns(environment: Mapping[str, str]) -> int | None:
    """The watchdog's period, if this process is the one that is watched."""
    pid = environment.get("WATCHDOG_PID")
    period_us = environment.get("WATCHDOG_USEC")
    if not period_us or (pid and int(pid) != os.getpid()):
        return None
    return int(period_us) * 1000
