"""Which way to a daemon: this machine's own sockets, or ssh.

Owns: what of a name, a computer and an address decides it. Must not know: how a way is gone.
"""

from __future__ import annotations

import importlib
import os

from etd.client.address import resolve
from etd.client.way import LocalWay, Way


def way_to(name: str, host: str | None, address: str | None) -> Way:
    """Raises: Refused for an address that cannot be used; DaemonGone if ssh does not connect."""
    if address is None:
        host = host_asked_for(host)
    if host is not None:
        # Loaded where it is used: a stop on this machine has no time for it.
        ssh: Way = importlib.import_module("etd.client.ssh").SshWay(host, name, address)
        return ssh
    return LocalWay(resolve(name, address))


def host_asked_for(host: str | None) -> str | None:
    """`host`, or else ETD_HOST; None: this computer."""
    return host or os.environ.get("ETD_HOST") or None
