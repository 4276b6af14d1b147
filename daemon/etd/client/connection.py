"""What the blocking and the asyncio display share: the session, the address, the sockets.

Owns: which sockets are open to the daemon, and when they are dropped. Must not know: requests, how
a reply is waited for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

import zmq

from etd.client import wire
from etd.client.session import Session
from etd.files.paths import DEFAULT_NAME, FRAMES, TELEMETRY, sibling_address
from etd.protocol.errors import DaemonGone

S = TypeVar("S", bound="zmq.Socket[Any]")


class Connection(ABC, Generic[S]):
    """One connection to one daemon.

    `name` is the daemon's; `address` replaces it. The limits come from `calibration` (a name the
    daemon knows), or from `max_current_ua` (50..10000) with `width_us` (20..200), or else from the
    daemon's default calibration. Nothing is felt before `arm()`. Nothing is repeated in the
    background: a frame that is not renewed expires, and a lease that is not renewed for a second
    ends, which disarms.

    Raises, from every method: DaemonGone (no daemon answers), Refused (code, reason, electrode).
    """

    def __init__(
        self,
        name: str = DEFAULT_NAME,
        *,
        address: str | None = None,
        client: str | None = None,
        calibration: str | None = None,
        max_current_ua: int | None = None,
        width_us: int | None = None,
        timeout_s: float = 2.0,
    ) -> None:
        self._session = Session(
            client or wire.program_name(),
            calibration=calibration,
            max_current_ua=max_current_ua,
            width_us=width_us,
            timeout_s=timeout_s,
        )
        self.address = wire.resolve(name, address)
        self._timeout_s = timeout_s
        self._context = self._new_context()
        self._control: S | None = None
        self._frames: S | None = None
        self._begin()

    @abstractmethod
    def _new_context(self) -> zmq.Context[S]:
        """Whose sockets block, or are awaited."""

    def _begin(self) -> None:
        """Called when made."""

    def _telemetry_address(self) -> str:
        facts = self._session.facts
        return facts.endpoints.telemetry if facts else sibling_address(self.address, TELEMETRY)

    def _connected(self) -> S:
        if self._context.closed:
            raise DaemonGone(self.address, "this display was closed: make a new one")
        if self._control is None:
            self._control = wire.configure(self._context.socket(zmq.DEALER), self.address)
        return self._control

    def _frames_socket(self) -> S:
        if self._frames is None:
            facts = self._session.facts
            address = facts.endpoints.frames if facts else sibling_address(self.address, FRAMES)
            self._frames = wire.configure(self._context.socket(zmq.PUSH), address)
        return self._frames

    def _drop_control(self) -> None:
        """What was not answered must not reach a daemon that comes back later."""
        if self._control is not None:
            self._control.close()
            self._control = None

    def _hang_up(self) -> None:
        self._context.destroy(linger=0)
