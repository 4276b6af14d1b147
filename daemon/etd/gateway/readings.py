"""Calibration files that are read for clients, one at a time, by a process, without a wait.

Owns: whose file is read next, how long one may take, and who is told. Must not know: how a file is
read, what a client asked for. Time comes in.

A file of the largest size takes half a second of a PC, and one that was made to takes what the
reading process is allowed: meanwhile the gateway hears stops, frames and signs of life. Users take
turns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from etd.files.calibration_process import CalibrationReader
from etd.gateway.parsed_files import ParsedFiles, Seen, seen
from etd.gateway.turns import Sender, Turns
from etd.protocol.errors import Refused
from etd.protocol.link import Answer

#: As in the engine: starting Python takes a second on a small machine, and the largest file two.
READ_WITHIN_NS: Final = 8_000_000_000


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What a request waits for, and whose request it is."""

    ref: int
    uid: int
    left: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class _UnderWay:
    wanted: _Wanted
    as_seen: Seen | None
    until_ns: int

    @property
    def path(self) -> Path:
        return self.wanted.left[0]


class CalibrationReadings:
    """`read`: where it is kept what a file held. `is_waited_for`: whether a ref is."""

    def __init__(
        self, reader: CalibrationReader, read: ParsedFiles, is_waited_for: Callable[[int], bool]
    ) -> None:
        self._reader = reader
        self._read = read
        self._is_waited_for = is_waited_for
        self._waiting: Turns[_Wanted] = Turns()
        self._under_way: _UnderWay | None = None

    @property
    def is_idle(self) -> bool:
        return self._under_way is None and not self._waiting

    def ask(self, ref: int, uid: int, paths: Sequence[Path]) -> None:
        """`answers` has an answer with this ref once all of them were read."""
        self._wait(_Wanted(ref, uid, tuple(paths)))

    def answers(self, now_ns: int) -> list[Answer]:
        """Called once a turn: who has waited long enough. It does not wait itself."""
        found: list[Answer] = []
        while (under_way := self._under_way or self._begun(now_ns, found)) is not None:
            self._under_way = under_way
            if not self._has_ended(under_way, now_ns, found):
                break
            self._under_way = None
        return found

    def close(self) -> None:
        """Idempotent."""
        self._reader.cancel()

    def _begun(self, now_ns: int, found: list[Answer]) -> _UnderWay | None:
        """The next one; None: none waits, or the last reader is still ending."""
        wanted = self._next(found)
        if wanted is None:
            return None
        path = wanted.left[0]
        under_way = _UnderWay(wanted, seen(path), now_ns + READ_WITHIN_NS)
        try:
            self._reader.begin([path.stem], None)
        except Refused as refusal:
            if refusal.code == "busy":
                self._wait(wanted)
            else:
                found.append(Answer(ref=wanted.ref, error=refusal.code, reason=refusal.reason))
            return None
        return under_way

    def _has_ended(self, under_way: _UnderWay, now_ns: int, found: list[Answer]) -> bool:
        wanted = under_way.wanted
        try:
            read = self._reader.result()
        except Refused as refusal:
            # Not kept: the next time it may be read.
            found.append(Answer(ref=wanted.ref, error=refusal.code, reason=refusal.reason))
            return True
        if read is None:
            return now_ns >= under_way.until_ns and self._give_up(under_way, found)
        (calibration,) = read
        self._read.keep(under_way.path, under_way.as_seen, calibration)
        if len(wanted.left) > 1:
            self._wait(_Wanted(wanted.ref, wanted.uid, wanted.left[1:]))
        else:
            found.append(Answer(ref=wanted.ref))
        return True

    def _next(self, found: list[Answer]) -> _Wanted | None:
        """Whose file is to be read. What others have had read meanwhile is answered at once, and
        what no request waits for any more is left.
        """
        while (wanted := self._waiting.take()) is not None:
            left = tuple(path for path in wanted.left if self._read.get(path) is None)
            if not self._is_waited_for(wanted.ref):
                continue
            if left:
                return _Wanted(wanted.ref, wanted.uid, left)
            found.append(Answer(ref=wanted.ref))
        return None

    def _give_up(self, under_way: _UnderWay, found: list[Answer]) -> bool:
        self._reader.cancel()
        why = (
            f"reading {under_way.path} took longer than {READ_WITHIN_NS // 1_000_000_000} s: is it"
            " a calibration? (etd check FILE)"
        )
        found.append(Answer(ref=under_way.wanted.ref, error="bad_calibration", reason=why))
        return True

    def _wait(self, wanted: _Wanted) -> None:
        self._waiting.add(Sender(wanted.uid, 0), wanted)
