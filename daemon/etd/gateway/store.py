"""The calibrations that the gateway names and gives to clients, as it reads them.

Owns: their content for clients and records. Must not know: how one is written (the operator's own
process does that), what a calibration allows; the engine reads and checks for itself.
"""

from __future__ import annotations

from pathlib import Path

from etd.files.calibration_folder import CalibrationFolder
from etd.gateway.parsed_files import ParsedFiles
from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import digest_of
from etd.protocol.errors import FileError, Refused
from etd.protocol.opening import NamedCalibration


class CalibrationStore:
    """See `CalibrationFolder` for `with_shipped`."""

    def __init__(self, folder: Path, shipped: Path | None) -> None:
        self._folder = CalibrationFolder(folder, shipped)
        self._parsed = ParsedFiles()

    @property
    def folder(self) -> Path:
        """Where they are kept."""
        return self._folder.own

    def names(self, with_shipped: bool) -> tuple[str, ...]:
        """All names, sorted."""
        return self._folder.names(with_shipped)

    def get(self, name: str, with_shipped: bool) -> Calibration:
        """Raises: Refused (`not_found`, `bad_calibration`)."""
        path = self._folder.find(name, with_shipped)
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
        if each:
            self._folder.check_kept()
        read = [(name, self.get(name, with_shipped)) for name in each]
        return tuple(
            NamedCalibration(name=name, digest=digest_of(calibration), calibration=calibration)
            for name, calibration in read
        )
