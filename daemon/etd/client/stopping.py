"""Stop a daemon, and ask it nothing before.

Owns: the one request that needs no facts. Must not know: leases, how a daemon stops.

A `Display` greets the daemon when it is made. A greeting waits among the requests of others, and a
daemon that has no place for one more client hears a stop, and nothing else. What listens may be
another user's: see `bounded.py`.
"""

from __future__ import annotations

from etd.client.bounded import BoundedExchange
from etd.client.session import Session
from etd.client.ways import way_to


def stop_at(
    name: str, *, host: str | None, address: str | None, client: str, timeout_s: float
) -> None:
    """Arguments as a `Display` has them. Raises: DaemonGone, Refused."""
    way = way_to(name, host, address)
    try:
        way.check_there()
        session = Session(
            client,
            calibration=None,
            digest=None,
            max_current_ua=None,
            width_us=None,
            timeout_s=timeout_s,
        )
        BoundedExchange(way, session).run(session.stop())
    finally:
        way.close()
