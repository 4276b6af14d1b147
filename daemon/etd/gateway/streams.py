"""Streamed frames: of those that arrived, the newest is passed on.

Owns: counting the superseded ones, counting and reporting the refused ones. Must not know: requests
with an answer.

The newest is that of the lease's holder: other clients' frames are refused and supersede nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from etd.gateway.frames import FrameHandler
from etd.gateway.inbound import (
    InboundMessage,
    head_of_frame,
    inbound_of,
    read_frame,
    without_frames,
)
from etd.gateway.lease import StandingLease
from etd.gateway.listener import Listener
from etd.protocol.errors import Refused
from etd.protocol.messages import FrameRequest

#: At most this many are read in one turn; the kernel keeps the rest, bounded. No stop is
#: read within a turn, which therefore ends after so many bytes. A single frame can take 6 ms.
FRAMES_A_TURN = 64
BYTES_A_TURN = 16_384

Refusals = list[tuple[int | None, Refused]]


class Streams:
    """One socket that nothing is answered on."""

    def __init__(
        self,
        listener: Listener,
        handler: FrameHandler,
        counters: Counter[str],
        passed_on: Callable[[FrameRequest, int | None], None] = lambda *_: None,
    ) -> None:
        """`passed_on`: called with each frame that was passed on, and its sender's user id."""
        self._passed_on = passed_on
        self._listener = listener
        self._handler = handler
        self._counters = counters

    def drain(self) -> Refusals:
        """Pass the newest on; returns those that were refused, with their seq if it was read."""
        refusals: Refusals = []
        newest: tuple[FrameRequest, StandingLease] | None = None
        left_bytes = BYTES_A_TURN
        for connection, parts in self._listener.take(FRAMES_A_TURN):
            inbound = inbound_of(connection, parts)
            passed = self._checked(inbound, refusals)
            if passed is not None:
                newest = self._newer(newest, passed)
            left_bytes -= len(inbound.data)
            if left_bytes <= 0:
                break
        if newest is not None:
            try:
                self._handler.pass_on(*newest, ref=0)
            except Refused as refusal:
                refusals.append((newest[0].seq, refusal))
            else:
                self._passed_on(newest[0], newest[1].uid)
        self._counters.update(f"refused_{why.code}" for _, why in refusals)
        return refusals

    def _checked(
        self, inbound: InboundMessage, refusals: Refusals
    ) -> tuple[FrameRequest, StandingLease] | None:
        """None: it was added to these refusals."""
        seq = None
        try:
            # Arrays may take 10 ms to decode: whose they are is known without them.
            head = head_of_frame(inbound)
            seq = head.seq
            self._handler.check_lease(head.lease, inbound.uid)
            frame = read_frame(inbound)
            return frame, self._handler.check(frame, inbound.uid)
        except Refused as refusal:
            refusals.append((seq, without_frames(refusal)))
            return None

    def _newer(
        self,
        before: tuple[FrameRequest, StandingLease] | None,
        this: tuple[FrameRequest, StandingLease],
    ) -> tuple[FrameRequest, StandingLease]:
        if before is None:
            return this
        self._counters["superseded"] += 1
        return this if this[0].seq > before[0].seq else before
