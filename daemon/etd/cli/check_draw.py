"""`etd check --draw OUT.svg FILE`: which picture a file gets, and where it goes.

Owns: the kinds that can be drawn, the array on which a calibration or a pattern is drawn, and the
new file. Must not know: how anything is drawn (`etd.draw`).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import msgspec

from etd.draw.array_sheet import array_sheet
from etd.draw.board_sheet import board_sheet
from etd.draw.calibration_map import calibration_map
from etd.draw.pattern_strip import pattern_strip
from etd.draw.sheet import Picture
from etd.files.array import Array, array_for_count, load_array
from etd.files.atomic_file import write_atomically
from etd.files.calibration import load_calibration
from etd.files.check import Checked
from etd.files.configuration import read_array
from etd.files.etactilekit import read_layout
from etd.files.pattern import load_pattern
from etd.files.resources import find, names
from etd.protocol.errors import FileError
from etd_hal.boardfile import load_board

#: Of a person's data, as of the calibration's own file; and of all other pictures.
_PRIVATE, _PUBLIC = 0o640, 0o644
#: A layout does not say it, and the sheet would claim it.
_WHICH_SIDE = (
    "a layout does not say from which side it is drawn: find electrode 0 on the thing itself; it"
    " may be that the two sides below are swapped"
)


class Drawn(msgspec.Struct, frozen=True, kw_only=True):
    """A picture that was written: of which kind of file, and a sentence about what it shows."""

    file: str
    kind: str
    summary: str
    width_mm: float
    height_mm: float


def draw(args: argparse.Namespace, checked: Checked) -> Drawn:
    """Draw the file that was found valid. Raises: FileError."""
    path: Path = args.files[0]
    if checked.kind not in _PICTURES:
        raise FileError(
            str(path), "", f"there is no picture of a file of this kind ({checked.kind})",
            f"name a file of a kind that has one: {', '.join(_PICTURES)}",
        )  # fmt: skip
    if args.array is not None and checked.kind not in _PLACED:
        args.misused(f"--array is for a {' or a '.join(_PLACED[:2])}: {path} is none")
    picture = _PICTURES[checked.kind](path, args.array)
    mode = _PRIVATE if checked.kind == "calibration" else _PUBLIC
    try:
        write_atomically(args.draw, picture.svg.encode(), mode)
    except OSError as error:
        why = f"it cannot be written ({error.strerror})"
        raise FileError(str(args.draw), "", why, "name another file") from error
    return Drawn(
        file=str(args.draw),
        kind=checked.kind,
        summary=picture.summary,
        width_mm=round(picture.width_mm, 3),
        height_mm=round(picture.height_mm, 3),
    )


# --- each kind ---------------------------------------------------------------------------------


def _board(path: Path, _: str | None) -> Picture:
    return board_sheet(load_board(path))


def _array(path: Path, _: str | None) -> Picture:
    return array_sheet(load_array(path))


def _layout(path: Path, _: str | None) -> Picture:
    array, notes = read_layout(path)
    return array_sheet(array, (_WHICH_SIDE, *notes))


def _calibration(path: Path, given: str | None) -> Picture:
    calibration = load_calibration(path)
    if given is None and calibration.array not in names("arrays"):
        raise FileError(
            str(path), "array", f"it was made on {calibration.array!r}, which is no shipped array",
            "name the array's file: --array FILE",
        )  # fmt: skip
    array = _named(given or calibration.array)
    if array.name != calibration.array:
        raise FileError(
            str(path), "array",
            f"it was made on {calibration.array!r}, and --array names {array.name!r}",
            "name the array on which it was made",
        )  # fmt: skip
    _check_count(array, len(calibration.electrode), path, "electrode")
    return calibration_map(calibration, array)


def _pattern(path: Path, given: str | None) -> Picture:
    pattern, notes = load_pattern(path)
    array = _named(given or array_for_count(pattern.electrodes))
    _check_count(array, pattern.electrodes, path, "electrodes")
    return pattern_strip(pattern, array, path.stem, notes)


def _named(array: str) -> Array:
    """A shipped array, or one from a file, eTactileKit's layouts included. Raises: FileError."""
    return read_array(find("arrays", array))[0]


def _check_count(array: Array, electrodes: int, path: Path, key: str) -> None:
    if array.count != electrodes:
        raise FileError(
            str(path), key, f"it is for {electrodes} electrodes, {array.name} has {array.count}",
            "name an array of as many: --array FILE",
        )  # fmt: skip


_PICTURES: dict[str, Callable[[Path, str | None], Picture]] = {
    "array": _array,
    "board": _board,
    "calibration": _calibration,
    "pattern": _pattern,
    "eTactileKit layout": _layout,
    "eTactileKit pattern": _pattern,
}
#: What needs an array beside its own file.
_PLACED = ("calibration", "pattern", "eTactileKit pattern")
