"""What is printed of the calibrations of a lease.

Owns: the words. Must not know: where they come from.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.protocol.opening import LeaseCalibration
from etd.protocol.text import shown

#: Of a digest; enough to compare by eye.
_DIGITS = 12


def said_of_taken(calibrations: Sequence[LeaseCalibration]) -> str:
    """In a sentence, after "with"."""
    return ", ".join(map(_said, calibrations)) or "limits and no calibration"


def _said(calibration: LeaseCalibration) -> str:
    digest = calibration.digest[:_DIGITS]
    return shown(f"calibration {calibration.name} ({calibration.polarity}, digest {digest})")
