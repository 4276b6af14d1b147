"""A person's calibration: what each electrode may carry, and where feeling begins.

Owns: the file type, its loader and writer, its rules, and the level map (threshold to
comfortable). Must not know: who asks for a level, boards, time.

A calibration belongs to a participant code (never a name) and to every condition it was made
under; a `level` frame that departs from them is refused.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.frame import Polarity, Returns
from etd_hal.boardfile import load_toml
from etd_hal.errors import FileError

Ua = Annotated[int, Meta(ge=0, le=10_000)]


class ElectrodeLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One electrode: first feeling, comfortable level, and the cap that is never passed."""

    threshold_ua: Ua
    comfortable_ua: Ua
    cap_ua: Ua
    resistance_ohm: Annotated[int, Meta(ge=0)] | None = None


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A person's electrodes under stated conditions (DESIGN section 7)."""

    participant: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
    body_site: str
    array: str
    polarity: Polarity
    width_us: Annotated[int, Meta(ge=20, le=200)]
    rate_hz: Annotated[float, Meta(ge=0.1, le=200)]
    returns: Returns
    date: datetime.date
    program: str
    electrode: tuple[ElectrodeLimits, ...]
    #: I = threshold + (comfortable - threshold) x level^(1/gamma)
    gamma: Annotated[float, Meta(ge=0.5, le=3.0)] = 1.0


def current_of_level(limits: ElectrodeLimits, level: float, gamma: float) -> int:
    """The current, in uA, that a level stands for: 0 is silent, above 0 to 1 is threshold to
    comfortable, by a power law (science B11). Never more than comfortable.
    """
    if level <= 0.0:
        return 0
    span_ua = limits.comfortable_ua - limits.threshold_ua
    return limits.threshold_ua + int(span_ua * min(level, 1.0) ** (1.0 / gamma))


def check_order(calibration: Calibration, file: str) -> Calibration:
    """Threshold, comfortable and cap must rise. Raises: FileError."""
    for index, one in enumerate(calibration.electrode):
        if not one.threshold_ua <= one.comfortable_ua <= one.cap_ua:
            raise FileError(
                file,
                f"electrode[{index}]",
                f"threshold {one.threshold_ua}, comfortable {one.comfortable_ua}, cap {one.cap_ua}"
                " uA do not rise",
                "comfortable lies between threshold and cap",
            )
    return calibration


def load_calibration(path: Path) -> Calibration:
    """Read and check a calibration file. Raises: FileError."""
    return check_order(load_toml(path, Calibration), str(path))
