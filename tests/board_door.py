"""The second door of a process that plays a board: what happens to the world behind it.

Owns: one knock and its answer. Must not know: who plays the board, how it was started.
"""

from __future__ import annotations

import socket
from pathlib import Path

from etd_hal.fake import wire


def knock_at(door: Path, knock: wire.Knock, within_s: float) -> wire.State:
    """Do something to the world behind the board; the answer is the board's state."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as caller:
        caller.settimeout(within_s)
        caller.connect(str(door))
        caller.send(wire.encode(knock))
        answer = wire.decode_answer(caller.recv(wire.MAX_DATAGRAM_BYTES))
    assert isinstance(answer, wire.State)
    return answer
