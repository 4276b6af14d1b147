"""A lease that is being opened: its calibrations are read, and the loop does not wait for them.

Owns: which command is under way, for how long at most, and that what was read is what was meant.
Must not know: how a file is read (`files/calibration_process.py`), what a calibration allows,
states. Time comes in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from etd.files.calibration_process import CalibrationReader as CalibrationReader
from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import check_digest, digest_of
from etd.protocol.errors import Refused
from etd.protocol.link import OpenLease
from etd.protocol.opening import LeaseCalibration
from etd.protocol.peer import Peer

#: Starting Python takes a second on a small machine, and the largest file two. The gateway and the
#: client wait for longer.
READ_WITHIN_NS = 8_000_000_000


class GivenCalibrations:
    """A reader of what is at hand: the calibrations of a record, or none."""

    def __init__(self, calibrations: Mapping[str, Calibration]) -> None:
        self._calibrations = calibrations
        self._wanted: tuple[str, ...] = ()

    def begin(self, names: Sequence[str], _: Peer | None) -> None:
        """See `CalibrationReader`."""
        self._wanted = tuple(names)

    def result(self) -> tuple[Calibration, ...]:
        """See `CalibrationReader`."""
        missing = [name for name in self._wanted if name not in self._calibrations]
        if missing:
            raise Refused("not_found", f"there is no calibration {missing[0]!r}")
        return tuple(self._calibrations[name] for name in self._wanted)

    def cancel(self) -> None:
        """See `CalibrationReader`."""


class Opening:
    """At most one."""

    def __init__(self, reader: CalibrationReader) -> None:
        self._reader = reader
        #: The command under way.
        self.pending: OpenLease | None = None
        self._until_host_ns = 0

    def begin(self, command: OpenLease, gateway: Peer, host_ns: int) -> None:
        """Raises: Refused."""
        if self.pending is not None:
            raise Refused(
                "other_lease", f"a lease is being opened by {self.pending.client!r}: ask again"
            )
        self._reader.begin([wanted.name for wanted in command.calibrations], gateway)
        self.pending = command
        self._until_host_ns = host_ns + READ_WITHIN_NS

    def calibrations(self, host_ns: int) -> tuple[Calibration, ...] | None:
        """Of the pending command; None while they are read. Otherwise nothing is pending any more.

        Raises: Refused.
        """
        try:
            found = self._reader.result()
        except Refused:
            self.pending = None
            raise
        if found is not None:
            self.pending = None
        elif host_ns >= self._until_host_ns:
            self.cancel()
            raise Refused(
                "bad_calibration",
                f"reading took longer than {READ_WITHIN_NS // 1_000_000_000} s: is it a"
                " calibration? (etd check FILE)",
            )
        return found

    def cancel(self) -> None:
        """The one who asked is gone. Idempotent."""
        if self.pending is not None:
            self.pending = None
            self._reader.cancel()


def check_felt(calibrations: Sequence[Calibration], backend: str) -> None:
    """A board that a person is at plays nothing that a model answered for. Raises: Refused
    (`bad_calibration`).
    """
    if backend != "fake" and any(made.modelled for made in calibrations):
        raise Refused(
            "bad_calibration",
            "it was made on a fake board, and no person felt it (modelled = true): calibrate the"
            " person on this board",
        )


def taken(command: OpenLease, calibrations: Sequence[Calibration]) -> tuple[LeaseCalibration, ...]:
    """What the lease is opened with, as replies name it. Raises: Refused (`bad_calibration`)."""
    told = tuple(
        LeaseCalibration(
            name=wanted.name, polarity=made.polarity, digest=digest_of(made), unfelt=made.unfelt
        )
        for wanted, made in zip(command.calibrations, calibrations, strict=True)
    )
    for wanted, found in zip(command.calibrations, told, strict=True):
        check_digest(wanted.name, found.digest, wanted.digest)
    return told
