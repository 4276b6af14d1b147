"""Calibrations on disk, each a TOML file with the calibration's name.

Owns: which there are, writing and deleting one, how many there may be and how large, and what is
said to a user who may not write here. Must not know: who asks, what a calibration allows.

The operator's own process writes here. The engine and the gateway read; neither writes.
"""

from __future__ import annotations

import os
from pathlib import Path

from etd.files import paths
from etd.files.atomic_file import write_atomically
from etd.files.calibration import file_of
from etd.files.named_files import names_in, size_of
from etd.protocol.calibration import Calibration, check_order
from etd.protocol.errors import FileError, Refused

#: All names are in every `hello`; a study of a few hundred persons, with two polarities each, fits.
MOST_CALIBRATIONS = 1_000
#: Together; one of 256 electrodes takes some ten kilobytes.
MOST_IN_ALL_BYTES = 32 * 1024 * 1024
#: The largest that the protocol allows has fewer: 256 electrodes that each name all others.
MOST_FILE_BYTES = 512 * 1024
#: A folder may hold more files than are kept: only so many entries of it are read.
_MOST_LOOKED_AT = 4 * MOST_CALIBRATIONS
_SUFFIX = ".toml"


class CalibrationFolder:
    """The daemon's calibrations, and the shipped ones beneath them, read-only.

    The caller decides `with_shipped`: the shipped ones are for the fake's body only.
    """

    def __init__(self, own: Path, shipped: Path | None) -> None:
        self.own = own
        self._shipped = shipped

    def names(self, with_shipped: bool) -> tuple[str, ...]:
        """All names, sorted; of one's own no more than are kept."""
        own = names_in(self.own, _SUFFIX, _MOST_LOOKED_AT)[:MOST_CALIBRATIONS]
        shipped = names_in(self._shipped, _SUFFIX) if self._shipped and with_shipped else ()
        return tuple(sorted({*own, *shipped}))

    def find(self, name: str, with_shipped: bool) -> Path:
        """Raises: Refused (`not_found`)."""
        for folder in (self.own, self._shipped if with_shipped else None):
            # Whatever it is, and wherever a link leads: who reads it refuses what is no file.
            if folder is not None and os.path.lexists(folder / f"{name}.toml"):
                return folder / f"{name}.toml"
        known = ", ".join(self.names(with_shipped)) or "none"
        raise Refused("not_found", f"there is no calibration {name!r}; there are: {known}")

    def put(self, name: str, calibration: Calibration) -> None:
        """Store it as `name`, replacing an earlier one, which stays where this one is refused.

        Raises: Refused (`bad_calibration`, `not_permitted`).
        """
        if self._is_shipped(name):
            raise Refused(
                "bad_calibration", f"{name!r} is a shipped calibration: choose another name"
            )
        try:
            data = file_of(check_order(calibration, name), name)
        except FileError as error:
            raise Refused("bad_calibration", str(error)) from error
        try:
            paths.make_own(self.own, 0o750)
            self._check_room(f"{name}.toml", len(data))
            write_atomically(self.own / f"{name}.toml", data, mode=self._mode)
        except FileError as error:
            raise Refused("bad_calibration", f"{name!r} could not be stored: {error}") from error
        except PermissionError as error:
            raise not_permitted(self.own, f"{name!r} could not be stored") from error
        except OSError as error:
            raise Refused(
                "bad_calibration", f"{name!r} could not be stored in {self.own}: {error.strerror}"
            ) from error

    def check_may_write(self) -> None:
        """Before somebody works for what is to be stored. Raises: Refused (`not_permitted`)."""
        nearest = next(place for place in (self.own, *self.own.parents) if os.path.lexists(place))
        if not os.access(nearest, os.W_OK | os.X_OK):
            raise not_permitted(self.own, "a calibration could not be stored")

    def delete(self, name: str) -> None:
        """A lease that was opened with it keeps its limits until it ends.

        Raises: Refused (`not_found`, `bad_calibration`, `not_permitted`).
        """
        if self._is_shipped(name):
            raise Refused(
                "bad_calibration", f"{name!r} is a shipped calibration: it cannot be deleted"
            )
        path = self.own / f"{name}.toml"
        if not os.path.lexists(path):
            own = ", ".join(self.names(with_shipped=False)) or "none"
            raise Refused(
                "not_found",
                f"there is no calibration {name!r}; those that can be deleted: {own}",
            )
        try:
            path.unlink()
        except PermissionError as error:
            raise not_permitted(self.own, f"{name!r} could not be deleted") from error
        except OSError as error:
            raise Refused(
                "bad_calibration", f"{path} could not be deleted: {error.strerror}"
            ) from error

    @property
    def _mode(self) -> int:
        """Behind the system's folder, which keeps strangers out, the services read it as others."""
        return 0o644 if paths.SYSTEM_CALIBRATIONS in self.own.parents else 0o640

    def _check_room(self, file: str, new_bytes: int) -> None:
        """What is replaced makes room. Looks at all files, so it is the writer's alone: in the
        gateway it would take longer with each file. Raises: Refused (`bad_calibration`).
        """
        others = [path for path in self.own.iterdir() if path.name != file]
        taken_bytes = sum(map(size_of, others))
        why = ""
        if sum(path.suffix == ".toml" for path in others) >= MOST_CALIBRATIONS:
            why = f"no more than {MOST_CALIBRATIONS} calibrations are kept in {self.own}"
        elif taken_bytes + new_bytes > MOST_IN_ALL_BYTES:
            why = (
                f"the calibrations in {self.own} take {taken_bytes / 1e6:.1f} MB, and no more than"
                f" {MOST_IN_ALL_BYTES / 1e6:.1f} MB are kept"
            )
        if why:
            raise Refused(
                "bad_calibration",
                f"{why}: export some (`etd calibration export`), then delete them (`etd calibration"
                " delete`)",
            )

    def _is_shipped(self, name: str) -> bool:
        return self._shipped is not None and (self._shipped / f"{name}.toml").exists()


def not_permitted(folder: Path, what: str) -> Refused:
    """`what` could not be done there; with what to do."""
    advice = f"run it as the user who owns {folder}"
    if paths.SYSTEM_CALIBRATIONS in folder.parents:
        advice = (
            "have this user added to the group of operators (sudo adduser NAME etd-operators), log"
            " in again; the folder is made when the engine's service starts"
        )
    return Refused("not_permitted", f"{what}: this user may not write into {folder}: {advice}")
