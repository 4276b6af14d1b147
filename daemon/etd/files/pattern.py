"""Patterns: frames one after another, each for its time, for an array of so many electrodes.

Owns: the project's own pattern file, its reader, and the recognition of eTactileKit's.
Must not know: currents (a pattern says how strongly, relative to what the player is told), boards,
the daemon.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta

from etd.files import etactilekit
from etd.files.json_file import read_json
from etd.protocol.errors import PatternError
from etd.protocol.frame import MAX_ELECTRODES, Level, PerElectrode, Polarity, RateHz
from etd_hal.errors import FileError
from etd_hal.tomlfile import convert

MAX_FRAMES = 20_000
#: Ten minutes: a frame that stands longer is a mistake in the unit.
MAX_FRAME_MS = 600_000

T = TypeVar("T")
Electrodes = Annotated[int, Meta(ge=1, le=MAX_ELECTRODES)]


class PatternFrame(msgspec.Struct, frozen=True, kw_only=True):
    """One frame: `level` has one value from 0 to 1 for each electrode.

    It is up for `duration_ms`, then the skin is silent for `off_ms`. Rate and polarity are None
    where the file leaves them to the player.
    """

    duration_ms: int
    off_ms: int = 0
    level: tuple[float, ...]
    rate_hz: float | None = None
    polarity: Polarity | None = None

    @property
    def active(self) -> tuple[int, ...]:
        """The electrodes that are felt."""
        return tuple(index for index, level in enumerate(self.level) if level > 0.0)


class Pattern(msgspec.Struct, frozen=True, kw_only=True):
    """All frames of a file, at least one, each for `electrodes` electrodes."""

    electrodes: int
    frames: tuple[PatternFrame, ...]

    @property
    def duration_ms(self) -> int:
        """From the first frame to the end of the last one's silence."""
        return sum(frame.duration_ms + frame.off_ms for frame in self.frames)


class _FrameInFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    duration_ms: Annotated[int, Meta(ge=1, le=MAX_FRAME_MS)]
    off_ms: Annotated[int, Meta(ge=0, le=MAX_FRAME_MS)] = 0
    level: Annotated[tuple[Level, ...], PerElectrode] | None = None
    active: Annotated[tuple[Annotated[int, Meta(ge=0)], ...], PerElectrode] | None = None
    rate_hz: RateHz | None = None
    polarity: Polarity | None = None


class _PatternInFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    etd_pattern: Literal[1]
    electrodes: Electrodes
    frames: Annotated[list[object], Meta(min_length=1, max_length=MAX_FRAMES)]


def load_pattern(path: Path) -> tuple[Pattern, tuple[str, ...]]:
    """A pattern file of ours or of eTactileKit, told apart by content.

    Returns the pattern and a sentence for each thing that had to be mended or left out.
    Raises: PatternError, naming file and, where there is one, frame.
    """
    try:
        data, mended = read_json(path)
    except FileError as error:
        raise PatternError(str(path), None, f"{error.value}; {error.allowed}") from None
    return pattern_of(data, mended, str(path))


def check_pattern(pattern: Pattern) -> Pattern:
    """One that a program has made: the bounds of a file hold for it too. Raises: PatternError."""
    data = {"etd_pattern": 1, **msgspec.to_builtins(pattern)}
    return pattern_of(data, (), "the pattern")[0]


def is_pattern(data: object) -> bool:
    """Whether the content of a JSON file looks like a pattern file of ours."""
    return isinstance(data, dict) and "etd_pattern" in data


def pattern_of(data: object, mended: tuple[str, ...], file: str) -> tuple[Pattern, tuple[str, ...]]:
    """As `load_pattern`, from content already read. Raises: PatternError."""
    if is_pattern(data):
        if mended:
            raise PatternError(file, None, f"it is not JSON: {mended[0]}, and must not be needed")
        return _pattern(data, file), ()
    if etactilekit.is_pattern(data):
        own, left_out = etactilekit.pattern_to_own(data, file)
        return _pattern(own, file), mended + left_out
    raise PatternError(
        file, None, "it is no pattern file: neither etd_pattern nor Pattern_Data is in it"
    )


def _pattern(data: object, file: str) -> Pattern:
    in_file = _convert(data, _PatternInFile, file, None)
    frames = tuple(
        _frame(_convert(entry, _FrameInFile, file, index), in_file.electrodes, file, index)
        for index, entry in enumerate(in_file.frames)
    )
    return Pattern(electrodes=in_file.electrodes, frames=frames)


def _convert(data: object, kind: type[T], file: str, index: int | None) -> T:
    try:
        return convert(data, kind, file)
    except FileError as error:
        where = f"{error.key}: " if error.key else ""
        raise PatternError(file, index, f"{where}{error.value}; {error.allowed}") from None


def _frame(frame: _FrameInFile, electrodes: int, file: str, index: int) -> PatternFrame:
    return PatternFrame(
        duration_ms=frame.duration_ms,
        off_ms=frame.off_ms,
        level=_levels(frame, electrodes, file, index),
        rate_hz=frame.rate_hz,
        polarity=frame.polarity,
    )


def _levels(frame: _FrameInFile, electrodes: int, file: str, index: int) -> tuple[float, ...]:
    if (frame.level is None) == (frame.active is None):
        raise PatternError(file, index, "give level or active, one of the two")
    if frame.level is not None:
        if len(frame.level) != electrodes:
            raise PatternError(
                file, index, f"level has {len(frame.level)} values for {electrodes} electrodes"
            )
        return frame.level
    active = frame.active or ()
    for electrode in active:
        if electrode >= electrodes:
            raise PatternError(
                file, index, f"active names electrode {electrode}: 0 to {electrodes - 1}"
            )
    if len(set(active)) != len(active):
        raise PatternError(file, index, "active names an electrode twice")
    return tuple(1.0 if electrode in active else 0.0 for electrode in range(electrodes))
