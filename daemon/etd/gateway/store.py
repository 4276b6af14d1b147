"""The calibrations that the gateway names and gives to clients, as they were read for it.

Owns: their content for clients and records, and which of them are still to be read. Must not know:
how one is read (`readings.py`) or written (the operator's own process does that), what a
calibration allows; the engine reads and checks for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from etd.files.calibration_folder import CalibrationFolder
from etd.gateway.parsed_files import ParsedFiles
from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import digest_of
from etd.protocol.errors import Refused
from etd.protocol.opening import NamedCalibration


class CalibrationStore:
    """See `CalibrationFolder` for `with_shipped`."""

    def __init__(self, folder: Path, shipped: Path | None) -> None:
        self._folder = CalibrationFolder(folder, shipped)
        #: What was read of them.
        self.read = ParsedFiles()

    @property
    def folder(self) -> Path:
        """Where they are kept."""
        return self._folder.own

    def names(self, with_shipped: bool) -> tuple[str, ...]:
        """All names, sorted."""
        return self._folder.names(with_shipped)

    def unread(self, names: Sequence[str], with_shipped: bool) -> tuple[Path, ...]:
        """Those files that are to be read first. Raises: Refused (`not_found`)."""
        paths = [self._folder.find(name, with_shipped) for name in names]
        return tuple(path for path in paths if self.read.get(path) is None)

    def get(self, name: str, with_shipped: bool) -> Calibration:
        """As it was read. Raises: Refused (`not_found`, `busy`)."""
        found = self.read.get(self._folder.find(name, with_shipped))
        if found is None:
            raise Refused("busy", f"{name!r} was written while it was read: ask again")
        return found

    def named(self, names: Sequence[str], with_shipped: bool) -> tuple[NamedCalibration, ...]:
        """Those of a lease, in the order of their names, as they were read.

        Raises: Refused (`not_found`, `bad_calibration`, `busy`).
        """
        read = [(name, self.get(name, with_shipped)) for name in names]
        return tuple(
            NamedCalibration(name=name, digest=digest_of(calibration), calibration=calibration)
            for name, calibration in read
        )
