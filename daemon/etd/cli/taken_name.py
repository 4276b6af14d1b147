"""A name that another calibration has already.

Owns: which calibrations are of one person and one use, so that one takes the other's place, and the
refusal where they are not. Must not know: how a calibration is made, where it is stored.
"""

from __future__ import annotations

import argparse

from etd.calibrate.conditions import Conditions
from etd.client import Display
from etd.protocol.calibration import Calibration
from etd.protocol.errors import FileError, Refused

#: A calibration of the same of these is a newer one of the same.
_OF_ONE = ("participant", "body_site", "array", "polarity")


def add_replace(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--replace",
        action="store_true",
        help="discard what is stored under that name, also of another person, body site, array or"
        " polarity",
    )


def check_name_is_theirs(
    args: argparse.Namespace, display: Display, which: str, new: Conditions | Calibration
) -> None:
    """`which` is free, or of the same person and use, or may be replaced: before anything is asked
    of the person. Raises: FileError, Refused.
    """
    if args.replace or which not in display.calibrations():
        return
    try:
        stored = display.calibration(which)
    except Refused as refused:
        raise _taken(which, f"a calibration that cannot be read ({refused.reason})") from None
    others = [key for key in _OF_ONE if getattr(stored, key) != getattr(new, key)]
    if others:
        of = ", ".join(f"{key} {getattr(stored, key)}" for key in others)
        raise _taken(which, f"a calibration of {of}")


def _taken(which: str, by: str) -> FileError:
    return FileError(
        "the calibration's name",
        which,
        f"it is the name of {by}, which would be lost",
        "choose another one with --as, or discard that with --replace",
    )
