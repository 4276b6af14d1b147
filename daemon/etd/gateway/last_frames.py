"""The last frames that were passed on to the engine: a record that begins tells what is shown.

Owns: how many are kept, and in what form. Must not know: records, who sends a frame, what one
means.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import msgspec

from etd.protocol.frame import Frame

#: More than may come, at a thousand a second, while one is shown.
_MOST = 256

_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(Frame)


class LastFrames:
    """Kept as bytes: the largest frame, decoded, takes several times of a message, and as many as
    these would be half of what the gateway may have.
    """

    def __init__(self) -> None:
        #: The lease's token, the seq, and the frame.
        self._kept: deque[tuple[str, int, bytes]] = deque(maxlen=_MOST)

    def add(self, frame: Frame) -> None:
        self._kept.append((frame.lease, frame.seq, _encoder.encode(frame)))

    def since(self, lease: str, seq: int) -> Iterator[Frame]:
        """Those of this lease from `seq` on, in the order in which they were passed on."""
        for token, number, data in self._kept:
            if token == lease and number >= seq:
                yield _decoder.decode(data)
