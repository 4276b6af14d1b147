"""The bus trace: everything that crossed a port, as JSON Lines in order of time.

Owns: the format, so that anyone can decode it without this project's code. The first line carries
what a decoder needs; each further line is one event, `t_ns` the time of its effect.
Must not know: what the bytes mean.
"""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from etd_hal.boardfile import BoardFile, Relays


def header(board: BoardFile, electrodes: Sequence[int]) -> bytes:
    """The first line. `electrodes[i]` is the chain output of electrode i."""
    facts: dict[str, object] = {
        "etd_trace": 1,
        "board": board.name,
        "switch": board.switch.chip,
        "outputs": board.switch.outputs,
        "lines": board.used_lines(),
        "full_scale_ua": board.source.full_scale_ua,
        "codes": board.source.codes,
        "probe_current_ua": board.maxima.probe_current_ua,
        "electrodes": list(electrodes),
    }
    if isinstance(board.switch, Relays):
        for key in ("bits_per_electrode", "on_bit", "return_bit", "ton_us", "toff_us"):
            facts[key] = getattr(board.switch, key)
    return json.dumps(facts).encode() + b"\n"


def _past_no_link(path: str, flags: int) -> int:
    number = os.open(path, flags & ~os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    found = os.fstat(number)
    if stat.S_ISREG(found.st_mode):
        if found.st_nlink > 1:
            os.close(number)
            raise OSError(errno.EMLINK, "a second name of another file is in its place", path)
        os.ftruncate(number, 0)
    return number


class Trace:
    """Collects the events of one call and writes them at its end, whole.

    The file is unbuffered: after every call it is complete, whichever process is killed next.
    Without a file nothing is kept.
    """

    def __init__(self, file: BinaryIO | None = None) -> None:
        self._file = file
        self._events: list[bytes] = []
        self._wanted = file is not None

    @classmethod
    def to(cls, path: Path) -> Trace:
        """A new trace at `path`, or over an old one; a link there is not followed, nor a second
        name of another file: in a folder that others can write to, it may be another user's.

        Raises: OSError.
        """
        return cls(open(path, "wb", buffering=0, opener=_past_no_link))

    def begin(self, board: BoardFile, electrodes: Sequence[int]) -> None:
        if self._file is not None:
            self._file.write(header(board, electrodes))

    def gpio(self, t_ns: int, line: int, value: int) -> None:
        if self._wanted:
            text = b'{"t_ns": %d, "bus": "gpio", "line": %d, "value": %d}\n'
            self._events.append(text % (t_ns, line, value))

    def spi_message(self, t_ns: int, transfers: int) -> None:
        if self._wanted:
            text = b'{"t_ns": %d, "bus": "spi", "event": "message", "transfers": %d}\n'
            self._events.append(text % (t_ns, transfers))

    def spi_cs(self, t_ns: int, active: bool) -> None:
        if self._wanted:
            text = b'{"t_ns": %d, "bus": "spi", "event": "cs", "active": %s}\n'
            self._events.append(text % (t_ns, b"true" if active else b"false"))

    def spi_transfer(self, t_ns: int, tx: bytes, rx: bytes, delay_us: int, cs_change: bool) -> None:
        if self._wanted:
            text = (
                b'{"t_ns": %d, "bus": "spi", "event": "transfer", "tx": "%s", "rx": "%s",'
                b' "delay_us": %d, "cs_change": %s}\n'
            )
            change = b"true" if cs_change else b"false"
            words = (tx.hex().encode(), rx.hex().encode())
            self._events.append(text % (t_ns, *words, delay_us, change))

    def spi_done(self, t_ns: int, byte_count: int) -> None:
        if self._wanted:
            text = b'{"t_ns": %d, "bus": "spi", "event": "done", "bytes": %d}\n'
            self._events.append(text % (t_ns, byte_count))

    def i2c(self, t_ns: int, address: int, tx: bytes, rx: bytes) -> None:
        if self._wanted:
            text = b'{"t_ns": %d, "bus": "i2c", "addr": %d, "tx": "%s", "rx": "%s"}\n'
            words = (tx.hex().encode(), rx.hex().encode())
            self._events.append(text % (t_ns, address, *words))

    def engine(self, t_ns: int, event: str, seq: int, tag: int | str | None) -> None:
        if self._wanted:
            text = b'{"t_ns": %d, "bus": "engine", "event": "%s", "seq": %d, "tag": %s}\n'
            tag_text = json.dumps(tag).encode()
            self._events.append(text % (t_ns, event.encode(), seq, tag_text))

    def body(
        self,
        electrode: int,
        from_ns: int,
        to_ns: int,
        asked_ua: int,
        current_ua: int,
    ) -> None:
        if self._wanted:
            text = (
                b'{"t_ns": %d, "bus": "body", "electrode": %d, "from_ns": %d, "to_ns": %d,'
                b' "asked_ua": %d, "current_ua": %d}\n'
            )
            values = (to_ns, electrode, from_ns, to_ns, asked_ua, current_ua)
            self._events.append(text % values)

    def write(self) -> None:
        """Put the events of one call on file. They were collected in order of time."""
        if self._file is None or not self._events:
            return
        self._file.write(b"".join(self._events))
        self._events.clear()

    def close(self) -> None:
        self.write()
        if self._file is not None:
            self._file.close()
