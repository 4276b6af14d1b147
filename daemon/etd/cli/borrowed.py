"""A calibration of the daemon, lent to a private fake, whose own daemon has the shipped ones only.

Owns: where it is looked for (the running daemon, or else its folder), and which array it is for.
Must not know: what it is used for.
"""

from __future__ import annotations

import os

from etd.client import Display
from etd.files import resources
from etd.files.calibration import load_calibration
from etd.files.paths import check_name, kept_calibrations
from etd.protocol.calibration import Calibration
from etd.protocol.errors import DaemonGone, Refused


def calibration_of(name: str, which: str) -> Calibration | None:
    """The calibration `which` of the daemon `name`, or the shipped one; None if there is none.

    Raises: FileError for a name that cannot be one, or a file that is none.
    """
    check_name(which, "the calibration's name")
    try:
        with Display(name) as display:
            return display.calibration(which)
    except DaemonGone:
        return _stored(name, which) or _shipped(which)
    except Refused:
        return _shipped(which)


def array_of(calibration: Calibration | None) -> str | None:
    """The shipped array that it was made for."""
    if calibration is None or calibration.array not in resources.names("arrays"):
        return None
    return calibration.array


def lend(
    address: str, name: str, which: str, calibration: Calibration | None, timeout_s: float = 2.0
) -> None:
    """So that the private daemon at `address`, which answers within the time, has it, as the daemon
    `name` does.

    Raises: Refused (`not_found` if neither has it; `bad_calibration` if it is for another array).
    """
    with Display(address=address, timeout_s=timeout_s) as private:
        there = private.calibrations()
        if which in there:
            return
        if calibration is None:
            raise Refused(
                "not_found",
                f"there is no calibration {which!r}: neither has the daemon {name!r} one"
                " (`etd calibration list`), nor is it shipped for this fake"
                f" ({', '.join(there) or 'none is'})",
            )
        private.set_calibration(which, calibration)


def _shipped(which: str) -> Calibration | None:
    if which not in resources.names("calibrations"):
        return None
    return load_calibration(resources.find("calibrations", which))


def _stored(name: str, which: str) -> Calibration | None:
    for folder in kept_calibrations(name):
        path = folder / f"{which}.toml"
        # A folder that this user may not enter has none for this user.
        if os.access(path, os.R_OK):
            return load_calibration(path)
    return None
