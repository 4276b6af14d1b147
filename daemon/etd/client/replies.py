"""What a reply is to the request that waits for it, however it came.

Owns: telling replies to it from others, and from what is none. Must not know: sockets.
"""

from __future__ import annotations

from etd.client.session import UNREADABLE, Ask, Session
from etd.client.way import Way, unreadable
from etd.protocol.messages import Success


def settled(session: Session, way: Way, ask: Ask, data: bytes) -> Success | None:
    """The reply to `ask`; None if it answers another. Raises: Refused; DaemonGone for what is no
    reply: a socket may be of any program.
    """
    try:
        return session.settle(ask, data)
    except UNREADABLE as error:
        raise unreadable(way, ask.op, error) from None
