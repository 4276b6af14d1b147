"""The trials of a calibration, one row each, as a table of text (TSV) that outlives a crash.

Owns: the columns, the file's name, and that no file is overwritten. Must not know: procedures,
keys, where answers come from.

Columns are named as in BIDS where it has a name: `onset`, `duration` and `response_time` in
seconds, `n/a` for what there is not. Onset counts from the first trial; `time` is its wall time.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from etd.calibrate.answers import Answer, Ask, Presentation
from etd.calibrate.conditions import Conditions
from etd.cli.new_file import check_new_file
from etd.protocol.errors import FileError

COLUMNS = (
    "onset",
    "duration",
    "time",
    "trial",
    "electrode",
    "current_ua",
    "commanded_ua",
    "reference",
    "reference_ua",
    "reference_place",
    "question",
    "answer",
    "response_time",
    "resistance_ohm",
    "method",
    "width_us",
    "rate_hz",
    "pulses",
    "polarity",
)
#: Of one name, where a calibration is begun several times within a second.
_MOST_ALIKE = 100
_MADE = re.compile(r"(?P<begun>.+_\d{8}-\d{6})(?:-(?P<number>\d+))?_trials\.tsv")


class TrialsFile:
    """Made with the first trial, and complete after each. Raises: FileError."""

    def __init__(
        self,
        path: Path,
        conditions: Conditions,
        now_ns: Callable[[], int],
        wall_offset_ns: Callable[[], int],
    ) -> None:
        """`now_ns`: the clock that presentations are timed by; `wall_offset_ns`: how far the wall
        time is ahead of it.
        """
        self._path = path
        self._conditions = conditions
        self._now_ns = now_ns
        self._wall_offset_ns = wall_offset_ns
        self._file: TextIO | None = None
        self._first_ns = 0
        self._trials = 0
        self._last: Presentation | None = None

    @property
    def name(self) -> str | None:
        """Of the file; None as long as there was no trial."""
        return None if self._file is None else str(self._path)

    def answered(self, presented: Presentation, ask: Ask, answer: Answer | None) -> None:
        """Add a trial, or a second question about the same one. Raises: FileError."""
        now_ns = self._now_ns()
        try:
            file = self._file or self._made(presented)
            if presented is not self._last:
                self._last, self._trials = presented, self._trials + 1
            print(*self._row(presented, ask, answer, now_ns), sep="\t", file=file, flush=True)
        except OSError as error:
            raise FileError(
                str(self._path),
                "",
                f"the trial could not be written ({error.strerror})",
                "the calibration ended: see that there is room, then continue it",
            ) from error

    def close(self) -> None:
        """Idempotent. What could not be written was told then: each row is flushed."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    def _made(self, first: Presentation) -> TextIO:
        self._file = file = self._opened()
        self._first_ns = first.begun_ns
        print(*COLUMNS, sep="\t", file=file, flush=True)
        return file

    def _opened(self) -> TextIO:
        """Between the choice of the name and the first trial another calibration of the same second
        may have taken it: this one then has the next. A name that was given is that one alone.
        """
        while True:
            try:
                return self._path.open("x", encoding="utf-8")
            except FileExistsError:
                following = _following(self._path)
                if following is None:
                    raise
                self._path = following

    def _row(
        self, presented: Presentation, ask: Ask, answer: Answer | None, now_ns: int
    ) -> tuple[object, ...]:
        conditions = self._conditions
        # The whole array may be slower than asked for.
        rate_hz = presented.rate_hz or conditions.rate_hz
        wall_s = (presented.begun_ns + self._wall_offset_ns()) / 1e9
        wall = datetime.datetime.fromtimestamp(wall_s).astimezone()
        known = (
            _seconds(presented.begun_ns - self._first_ns),
            f"{conditions.pulses / rate_hz:.3f}",
            wall.isoformat(timespec="milliseconds"),
            self._trials,
            presented.electrode,
            presented.current_ua,
            presented.commanded_ua,
            presented.reference,
            presented.reference_ua,
            _place_of_reference(presented),
            ask,
            answer,
            None if answer is None else _seconds(now_ns - presented.begun_ns),
            presented.resistance_ohm,
            conditions.method,
            conditions.width_us,
            f"{rate_hz:g}",
            conditions.pulses,
            conditions.polarity,
        )
        return tuple("n/a" if value is None else value for value in known)


def new_trials_path(
    folder: Path, which: str, array: str, begun: datetime.datetime, given: Path | None = None
) -> Path:
    """`given`, or else a name in `folder` that says person, array and time.

    Raises: FileError, if it exists, or could not be written.
    """
    if given is not None:
        check_new_file(given)
        return given
    plain = re.sub(r"[^A-Za-z0-9._-]", "-", array)
    name = f"{which}_{plain}_{begun:%Y%m%d-%H%M%S}"
    endings = ("", *(f"-{number}" for number in range(2, _MOST_ALIKE)))
    paths = [folder / f"{name}{ending}_trials.tsv" for ending in endings]
    path = next((path for path in paths if not path.exists()), paths[-1])
    check_new_file(path)
    return path


def _following(path: Path) -> Path | None:
    """The next one of those that begin in the same second; None after the last, and of a name that
    is none of `new_trials_path`.
    """
    made = _MADE.fullmatch(path.name)
    number = 0 if made is None else int(made["number"] or 1) + 1
    if made is None or number >= _MOST_ALIKE:
        return None
    return path.with_name(f"{made['begun']}-{number}_trials.tsv")


def _place_of_reference(presented: Presentation) -> int | None:
    """1 or 2: what was presented before or after the electrode."""
    if presented.reference is None:
        return None
    return 2 if presented.is_reference_last else 1


def _seconds(duration_ns: int) -> str:
    return f"{duration_ns / 1e9:.3f}"
