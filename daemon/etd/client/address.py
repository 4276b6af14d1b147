"""The address of a daemon's control socket.

Owns: refusing addresses that cannot be used, and whether a daemon listens at one. Must not know:
ZeroMQ (a stop loads this, and nothing that it has no use for), messages.
"""

from __future__ import annotations

from pathlib import Path

from etd.files.paths import control_address, why_unreachable
from etd.protocol.errors import DaemonGone, Refused


def resolve(name: str, address: str | None) -> str:
    """The control address. Raises: Refused for an unsupported transport."""
    if address is None:
        return control_address(name)
    if address.startswith("tcp://"):
        raise Refused(
            "not_permitted",
            f"{address}: connections over a network are not supported, because they would not be"
            " authenticated: use the daemon's Unix socket (ipc://), or name the computer, which is"
            " reached by your own ssh: Display(host='user@computer'), --host or ETD_HOST",
        )
    if not address.startswith("ipc://") or not Path(address.removeprefix("ipc://")).name:
        raise Refused(
            "bad_message",
            f"{address!r} is not an address: use one like ipc:///run/etd/NAME/control.sock",
        )
    return address


def check_there(address: str) -> None:
    """Raises: DaemonGone if no daemon listens at this ipc address, at once and with the reason."""
    why = why_unreachable(Path(address.removeprefix("ipc://")))
    if why is not None:
        raise DaemonGone(address, why)
