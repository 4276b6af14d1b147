"""The way to a daemon on this machine: the addresses of its three sockets.

Owns: what a display needs to know of a way, whichever it is (`ssh.py` is the other). Must not know:
messages, ZeroMQ.
"""

from __future__ import annotations

from typing import Protocol

from etd.client import calibration_files
from etd.client.address import check_there
from etd.files.paths import FRAMES, TELEMETRY, sibling_address
from etd.protocol.calibration import Calibration
from etd.protocol.errors import HELD_UP, DaemonGone
from etd.protocol.messages import HelloReply


class Way(Protocol):
    """Addresses that work from here."""

    control: str
    frames: str
    telemetry: str
    #: As errors name the daemon's place.
    place: str
    #: Whether the daemon's clock is this computer's.
    is_here: bool

    def check_there(self) -> None:
        """Before anything is sent. Raises: DaemonGone, with what to do."""

    def check_alive(self) -> None:
        """While an answer is awaited. Raises: DaemonGone, if none can come any more."""

    def check_may_store(self, facts: HelloReply) -> None:
        """Whether this user may store calibrations there. Raises: Refused, DaemonGone."""

    def put_calibration(self, facts: HelloReply, name: str, calibration: Calibration) -> None:
        """By a process of this user's on the daemon's machine. Raises: Refused, DaemonGone."""

    def delete_calibration(self, facts: HelloReply, name: str) -> None:
        """The same. Raises: Refused, DaemonGone."""

    def close(self) -> None:
        """Idempotent."""


class LocalWay:
    """The daemon's own sockets."""

    is_here = True

    def __init__(self, address: str) -> None:
        self.control = self.place = address
        self.frames = sibling_address(address, FRAMES)
        self.telemetry = sibling_address(address, TELEMETRY)

    def check_there(self) -> None:
        check_there(self.control)

    def check_alive(self) -> None:
        """A gateway that has ended may come back while it is waited for."""

    def check_may_store(self, facts: HelloReply) -> None:
        """By this process."""
        calibration_files.check_may_store(self.control, facts)

    def put_calibration(self, facts: HelloReply, name: str, calibration: Calibration) -> None:
        """By this process."""
        calibration_files.put(self.control, facts, name, calibration)

    def delete_calibration(self, facts: HelloReply, name: str) -> None:
        """By this process."""
        calibration_files.delete(self.control, facts, name)

    def close(self) -> None:
        """Nothing is held."""


def silent(way: Way, what: str) -> DaemonGone:
    """Of a daemon that was there when it was asked, and has not answered: what is known now."""
    try:
        way.check_there()
    except DaemonGone as gone:
        return DaemonGone(gone.address, f"{what}, and now {gone.what}", gone.advice)
    return DaemonGone(way.place, what, HELD_UP)


def closed(way: Way) -> DaemonGone:
    """Of a display that the program has closed, or that another of its threads closes."""
    return DaemonGone(way.place, "this display was closed: make a new one")


def unreadable(way: Way, op: str, error: Exception) -> DaemonGone:
    """Of what answered there, and does not speak as a daemon does."""
    return DaemonGone(
        way.place,
        f"the answer to {op} is no daemon's ({error})",
        "see what listens there: another program, or an etd of another version",
    )
