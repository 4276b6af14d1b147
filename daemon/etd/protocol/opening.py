"""With what a lease is opened, and what its reply says of that.

Owns: the limits of a person without a calibration, the names of calibrations, and how each of them
is told. Must not know: sockets, the engine, boards.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import MOST_CALIBRATIONS
from etd.protocol.frame import Name, Polarity
from etd_hal.names import whole

#: One name, or several: of one person's calibrations, each made with another polarity. The first
#: one's polarity is that of frames that name none.
CalibrationNames = (
    Name | Annotated[tuple[Name, ...], Meta(min_length=1, max_length=MOST_CALIBRATIONS)]
)

#: SHA-256, in hexadecimal digits.
DIGEST_PATTERN = whole("[0-9a-f]{64}")
Digest = Annotated[str, Meta(pattern=DIGEST_PATTERN)]
#: One for each name, in their order.
Digests = Annotated[tuple[Digest, ...], Meta(max_length=MOST_CALIBRATIONS)]


#: Of a lease without a calibration.
LEAST_LIMIT_UA = 50


class Limits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A person's limits without a calibration; both are needed."""

    max_current_ua: Annotated[int, Meta(ge=LEAST_LIMIT_UA, le=10_000)]
    width_us: Annotated[int, Meta(ge=20, le=200)]


class WantedCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """A calibration that a lease is to be opened with; another digest than `digest` is refused."""

    name: Name
    digest: Digest | None = None


WantedCalibrations = Annotated[tuple[WantedCalibration, ...], Meta(max_length=MOST_CALIBRATIONS)]


class LeaseCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """A calibration that a lease was opened with. `digest`: SHA-256 of its content. `unfelt`: the
    electrodes that were not felt, on which a level above 0 is refused.
    """

    name: str
    polarity: Polarity
    digest: str
    unfelt: tuple[int, ...] = ()


class NamedCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """The same with its content, for a record."""

    name: str
    digest: str
    calibration: Calibration
