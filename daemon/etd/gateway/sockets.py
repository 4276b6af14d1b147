"""The three sockets that clients meet, and the wait for any of them.

Owns: their files, types and bounds. Must not know: what a message means.
"""

from __future__ import annotations

import select
from collections import Counter
from pathlib import Path

from etd.files.paths import CONTROL, FRAMES, TELEMETRY
from etd.gateway.listener import Listener
from etd.gateway.places import MOST_GUESTS
from etd.gateway.subscribers import MAX_SUBSCRIPTION_BYTES, Subscribers
from etd.protocol.facts import Endpoints
from etd.protocol.messages import MAX_MESSAGE_BYTES


class Sockets:
    """Bound when made; one process, one thread."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._epoll = select.epoll()
        self._listeners: list[Listener] = []
        try:
            self.control = self._bound(b"ROUTER", CONTROL, MAX_MESSAGE_BYTES, MOST_GUESTS)
            self.frames = self._bound(b"PULL", FRAMES, MAX_MESSAGE_BYTES)
            self.telemetry = Subscribers(self._bound(b"XPUB", TELEMETRY, MAX_SUBSCRIPTION_BYTES))
        except BaseException:
            self.close()
            raise

    @property
    def endpoints(self) -> Endpoints:
        return Endpoints(
            frames=f"ipc://{self._folder / FRAMES}", telemetry=f"ipc://{self._folder / TELEMETRY}"
        )

    def wait(self, also: tuple[int, ...], timeout_ms: int) -> None:
        """Until a client, or one of `also`, has something."""
        both = select.poll()
        for fileno in (self._epoll.fileno(), *also):
            both.register(fileno, select.POLLIN)
        both.poll(0 if any(listener.has_more for listener in self._listeners) else timeout_ms)

    def look(self) -> None:
        """What each client has now."""
        for fileno, events in self._epoll.poll(0):
            for listener in self._listeners:
                listener.look(fileno, events)

    def take_counts(self) -> Counter[str]:
        """Of connections that ended, or were not let in, since the last call, by socket."""
        counts: Counter[str] = Counter()
        for listener in self._listeners:
            counts.update(listener.take_counts())
        counts.update(self.telemetry.take_counts())
        return counts

    def close(self) -> None:
        """Idempotent; takes the socket files away."""
        for listener in self._listeners:
            listener.close()
        self._epoll.close()

    def _bound(self, kind: bytes, name: str, most_bytes: int, most_guests: int = 0) -> Listener:
        listener = Listener(self._folder / name, kind, most_bytes, self._epoll, most_guests)
        self._listeners.append(listener)
        return listener
