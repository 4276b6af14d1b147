"""A trace in memory that is still being written, read on from where it was read to.

Owns: that no line is decoded twice, however often a test looks. Must not know: what is in a trace.
"""

from __future__ import annotations

import io

import msgspec

from trace_decoder import Decoder, Facts, Phase, Record

#: Several times as fast as the standard library's, which the decoder itself keeps to.
_lines = msgspec.json.Decoder()


class FollowedTrace:
    """What was written to `sink` so far."""

    def __init__(self, sink: io.BytesIO) -> None:
        self._sink = sink
        self._read = 0
        self._records: list[Record] = []
        self._decoder: Decoder | None = None
        self._decoded = 1

    def records(self) -> list[Record]:
        """The header first; not to be changed."""
        with self._sink.getbuffer() as written:
            new = bytes(written[self._read :])
        # A line that is not whole yet is read the next time.
        whole = new[: new.rfind(b"\n") + 1]
        self._read += len(whole)
        self._records += _lines.decode_lines(whole)
        return self._records

    def phases(self) -> list[Phase]:
        """What flowed, as `trace_decoder.decode` says; not to be changed."""
        return self._followed().phases

    def unloaded(self) -> list[Phase]:
        """What went into the node alone, as `trace_decoder` says; not to be changed."""
        return self._followed().unloaded

    def unselected(self) -> list[Phase]:
        """The same with all outputs live, and none selected."""
        return self._followed().unselected

    def _followed(self) -> Decoder:
        records = self.records()
        if self._decoder is None:
            self._decoder = Decoder(Facts.of(records[0]))
        for record in records[self._decoded :]:
            self._decoder.take(record)
        self._decoded = len(records)
        return self._decoder
