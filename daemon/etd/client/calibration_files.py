"""A calibration stored or deleted on this computer, by this process: not through the daemon.

Owns: in which folder, and that it fits the daemon's array. Must not know: sockets, messages, how a
file is written (`files/calibration_folder.py`).

The daemon's gateway is not asked to write it: a gateway that was taken over must not choose what
bounds a person's current (docs/decisions/0075). Nor may it choose the folder: of a daemon of the
system's that is known, and only a daemon of this user's own is believed.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from etd.files import paths, resources
from etd.files.calibration_folder import CalibrationFolder
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.messages import HelloReply
from etd.protocol.text import NAME_PATTERN, PATTERN_IN_WORDS


def put(control: str, facts: HelloReply, name: str, calibration: Calibration) -> None:
    """For the daemon at `control`. Raises: Refused (`bad_calibration`, `not_permitted`)."""
    check_fits(calibration, facts)
    _folder(control, facts).put(checked(name), calibration)


def check_may_store(control: str, facts: HelloReply) -> None:
    """Raises: Refused (`not_permitted`)."""
    _folder(control, facts).check_may_write()


def delete(control: str, facts: HelloReply, name: str) -> None:
    """Raises: Refused (`not_found`, `bad_calibration`, `not_permitted`)."""
    _folder(control, facts).delete(checked(name))


def checked(name: str) -> str:
    """A name that is a file's everywhere. Raises: Refused (`bad_message`)."""
    if isinstance(name, str) and re.search(NAME_PATTERN, name):
        return name
    raise Refused("bad_message", f"name={name!r}: {PATTERN_IN_WORDS[NAME_PATTERN]}")


def check_fits(calibration: Calibration, facts: HelloReply) -> None:
    """Array and body site; the engine checks its maxima. Raises: Refused (`bad_calibration`)."""
    for what, given, here in (
        ("array", calibration.array, facts.array.name),
        ("body_site", calibration.body_site, facts.body_site),
        ("number of electrodes", len(calibration.electrode), facts.array.electrodes),
    ):
        if given != here:
            raise Refused(
                "bad_calibration",
                f"the calibration's {what} is {given}, this daemon's is {here}: use a calibration"
                " made with this configuration",
            )


def _folder(control: str, facts: HelloReply) -> CalibrationFolder:
    """Raises: Refused (`not_permitted`)."""
    socket = Path(control.removeprefix("ipc://"))
    folder = Path(facts.calibrations_folder)
    if socket.parent.parent == paths.SYSTEM_RUNTIME:
        folder = paths.SYSTEM_CALIBRATIONS / socket.parent.name
    elif (owner := socket.stat().st_uid) != os.geteuid():
        raise Refused(
            "not_permitted",
            f"the daemon at {socket} was started by user {owner}, whose calibrations that user"
            " stores: run this as that user",
        )
    return CalibrationFolder(folder, resources.config_dir() / "calibrations")
