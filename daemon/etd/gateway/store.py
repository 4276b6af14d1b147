"""Calibrations on disk, each a TOML file with the calibration's name.

Owns: names, reading, atomic writing, and how many there may be. Must not know: what a calibration
allows; the engine checks that when one is opened.
"""

from __future__ import annotations

from pathlib import Path

from etd.files.atomic_file import write_atomically
from etd.files.calibration import to_toml
from etd.files.paths import make_own
from etd.gateway.parsed_files import ParsedFiles
from etd.protocol.calibration import Calibration, check_order
from etd.protocol.calibration_set import digest_of
from etd.protocol.errors import FileError, Refused
from etd.protocol.opening import NamedCalibration

#: All names are in every `hello`; a study of a few hundred persons, with two polarities each, fits.
MOST_CALIBRATIONS = 1_000
#: Together; one of 256 electrodes takes some ten kilobytes.
MOST_IN_ALL_BYTES = 32 * 1024 * 1024


class CalibrationStore:
    """The state directory's calibrations, and the shipped ones beneath them, read-only.

    The caller decides `with_shipped`: the shipped ones are for the fake's body only.
    """

    def __init__(self, state_dir: Path, shipped: Path | None) -> None:
        self._own = state_dir / "calibrations"
        self._shipped = shipped
        self._parsed = ParsedFiles()

    def names(self, with_shipped: bool) -> tuple[str, ...]:
        """All names, sorted."""
        folders = [self._own] + ([self._shipped] if self._shipped and with_shipped else [])
        return tuple(sorted({path.stem for folder in folders for path in folder.glob("*.toml")}))

    def get(self, name: str, with_shipped: bool) -> Calibration:
        """Raises: Refused (`not_found`, `bad_calibration`)."""
        path = self._find(name, with_shipped)
        try:
            return self._parsed.calibration(path)
        except FileError as error:
            raise Refused("bad_calibration", str(error)) from error

    def named(
        self, names: str | tuple[str, ...] | None, with_shipped: bool
    ) -> tuple[NamedCalibration, ...]:
        """Those of a lease, in the order of their names; none for None.

        Raises: Refused (`not_found`, `bad_calibration`).
        """
        each = (names,) if isinstance(names, str) else names or ()
        read = [(name, self.get(name, with_shipped)) for name in each]
        return tuple(
            NamedCalibration(name=name, digest=digest_of(calibration), calibration=calibration)
            for name, calibration in read
        )

    def put(self, name: str, calibration: Calibration) -> None:
        """Store it as `name`, replacing an earlier one. Raises: Refused (`bad_calibration`)."""
        if self._is_shipped(name):
            raise Refused(
                "bad_calibration", f"{name!r} is a shipped calibration: choose another name"
            )
        try:
            check_order(calibration, name)
        except FileError as error:
            raise Refused("bad_calibration", str(error)) from error
        data = to_toml(calibration).encode()
        try:
            make_own(self._own, 0o750)
            self._check_room(f"{name}.toml", len(data))
            write_atomically(self._own / f"{name}.toml", data, mode=0o640)
        except FileError as error:
            raise Refused("bad_calibration", f"{name!r} could not be stored: {error}") from error
        except OSError as error:
            raise Refused(
                "bad_calibration", f"{name!r} could not be stored in {self._own}: {error.strerror}"
            ) from error

    def delete(self, name: str) -> None:
        """A lease that was opened with it keeps its limits until it ends.

        Raises: Refused (`not_found`, `bad_calibration`).
        """
        if self._is_shipped(name):
            raise Refused(
                "bad_calibration", f"{name!r} is a shipped calibration: it cannot be deleted"
            )
        path = self._own / f"{name}.toml"
        if not path.is_file():
            own = ", ".join(self.names(with_shipped=False)) or "none"
            raise Refused(
                "not_found",
                f"there is no calibration {name!r}; those that can be deleted: {own}",
            )
        try:
            path.unlink()
        except OSError as error:
            raise Refused(
                "bad_calibration", f"{path} could not be deleted: {error.strerror}"
            ) from error

    def _check_room(self, file: str, new_bytes: int) -> None:
        """What is replaced makes room. Raises: Refused (`bad_calibration`)."""
        others = [path for path in self._own.iterdir() if path.name != file]
        taken_bytes = sum(path.lstat().st_size for path in others)
        why = ""
        if sum(path.suffix == ".toml" for path in others) >= MOST_CALIBRATIONS:
            why = f"there are {MOST_CALIBRATIONS} calibrations, and no more are kept"
        elif taken_bytes + new_bytes > MOST_IN_ALL_BYTES:
            why = (
                f"the calibrations in {self._own} take {taken_bytes / 1e6:.1f} MB, and no more than"
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

    def _find(self, name: str, with_shipped: bool) -> Path:
        for folder in (self._own, self._shipped if with_shipped else None):
            if folder is not None and (folder / f"{name}.toml").is_file():
                return folder / f"{name}.toml"
        known = ", ".join(self.names(with_shipped)) or "none"
        raise Refused("not_found", f"there is no calibration {name!r}; there are: {known}")
