"""A person's calibration: what each electrode may carry, and where feeling begins.

Owns: the file type, its loader and writer, its rules, and the level map (threshold to comfortable).
Must not know: where a level comes from, boards, time.

A calibration belongs to a participant code (never a name) and to every condition it was made
under; a `level` frame that departs from them is refused.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from etd.protocol.errors import Refused
from etd.protocol.frame import Name, PlainText, Polarity, Returns
from etd.pulse.measured import MAX_SKIN_OHM, MIN_SKIN_OHM
from etd.stabilize.shape import PLAIN, Shape
from etd_hal.errors import FileError

Ua = Annotated[int, Meta(ge=0, le=10_000)]
Method = Literal["limits", "staircase", "quest-plus", "equalize"]


class ElectrodeLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One electrode: threshold, comfortable level, and the cap that is never exceeded."""

    threshold_ua: Ua
    comfortable_ua: Ua
    cap_ua: Ua
    #: Of a contact with skin: `check_order` refuses a value that no skin has.
    resistance_ohm: int | None = None
    #: False: nothing was felt up to the cap, or nothing was tried; then the three currents are
    #: bounds only.
    felt: bool = True
    #: Where it differs from the file's date: the day on which the values were found.
    date: datetime.date | None = None
    #: Where threshold and cap are an earlier day's than the rest, which was matched to a reference.
    threshold_date: datetime.date | None = None


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A person's electrodes under stated conditions (DESIGN section 7)."""

    participant: Name
    body_site: PlainText
    array: PlainText
    polarity: Polarity
    width_us: Annotated[int, Meta(ge=20, le=200)]
    rate_hz: Annotated[float, Meta(ge=0.1, le=200)]
    returns: Returns
    date: datetime.date
    program: PlainText
    electrode: tuple[ElectrodeLimits, ...]
    #: I = threshold + (comfortable - threshold) x level^(1/gamma)
    gamma: Annotated[float, Meta(ge=0.5, le=3.0)] = 1.0
    #: How thresholds were found, and the number of pulses in a presentation.
    method: Method | None = None
    pulses: Annotated[int, Meta(ge=1, le=1_000)] | None = None
    #: The shape that the body site gave every pulse then. A file without it was made with plain
    #: pulses.
    shape: Shape = PLAIN


def current_of_level(limits: ElectrodeLimits, level: float, gamma: float) -> int:
    """The current of a level, in uA: 0 is silent, above 0 to 1 is threshold to comfortable, by a
    power law (science B11). Never more than comfortable.
    """
    if level <= 0.0:
        return 0
    span_ua = limits.comfortable_ua - limits.threshold_ua
    return limits.threshold_ua + int(span_ua * min(level, 1.0) ** (1.0 / gamma))


def currents_of_levels(calibration: Calibration, levels: Sequence[float]) -> tuple[int, ...]:
    """The currents of all electrodes. An electrode that was not felt has neither threshold nor
    comfortable level: its values are bounds, and a level has no meaning there.

    Raises: Refused (`level_needs_calibration`).
    """
    for electrode, (limits, level) in enumerate(zip(calibration.electrode, levels, strict=True)):
        if level > 0.0 and not limits.felt:
            raise Refused(
                "level_needs_calibration",
                f"electrode {electrode} was not felt when it was calibrated (felt = false), so a"
                " level has no meaning there: leave it out (level 0), or calibrate it again",
                electrode,
            )
    return tuple(
        current_of_level(limits, level, calibration.gamma)
        for limits, level in zip(calibration.electrode, levels, strict=True)
    )


def check_shape_of_levels(calibration: Calibration, shape: Shape) -> None:
    """A level means what it was calibrated to: the same shape. Raises: Refused (`bad_frame`)."""
    made_with, now = (made.at(calibration.width_us) for made in (calibration.shape, shape))
    if made_with != now:
        raise Refused(
            "bad_frame",
            f"level means what it was calibrated to, which is {made_with}; the body site's"
            f" [stabilize] now makes {now} of it: restore that, calibrate anew, or open"
            " with limits and send current_ua",
        )


def check_shape_of_caps(calibration: Calibration, shape: Shape) -> None:
    """A cap was accepted with the prepulse, probe and bursts of its calibration: with others it
    would let through more than was tried. `strength_duration` is checked for levels only: a named
    current that it would make stronger is refused when it is planned.

    Raises: Refused (`bad_frame`).
    """
    made_with, now = (replace(made, strength_duration=None) for made in (calibration.shape, shape))
    if made_with != now:
        raise Refused(
            "bad_frame",
            f"the calibration's caps were accepted with {made_with}; the body site's [stabilize]"
            f" now makes {now} of a frame: restore that, calibrate anew, or open with limits"
            " instead of the calibration",
        )


def check_order(calibration: Calibration, file: str) -> Calibration:
    """Threshold, comfortable and cap must rise, explicit returns must exist, and the resistance
    must be one that skin can have.

    Raises: FileError.
    """
    if isinstance(calibration.returns, tuple):
        _check_returns(calibration.returns, len(calibration.electrode), file)
    for index, limits in enumerate(calibration.electrode):
        if not limits.threshold_ua <= limits.comfortable_ua <= limits.cap_ua:
            raise FileError(
                file,
                f"electrode[{index}]",
                f"threshold {limits.threshold_ua}, comfortable {limits.comfortable_ua}, cap "
                f"{limits.cap_ua}"
                " uA do not rise",
                "comfortable lies between threshold and cap",
            )
        if not resisted_as_skin(limits):
            raise FileError(
                file,
                f"electrode[{index}].resistance_ohm",
                f"it says {limits.resistance_ohm}, which is too"
                f" {'low' if (limits.resistance_ohm or 0) < MIN_SKIN_OHM else 'high'} for skin",
                f"give a whole number from {MIN_SKIN_OHM:.0f} to {MAX_SKIN_OHM:.0f}, as a pulse"
                " measured it, or leave it out: the stabilizers then compare with the first"
                " resistance that they measure",
            )
    return calibration


def resisted_as_skin(limits: ElectrodeLimits) -> bool:
    """Whether the resistance is one that skin can have, or is not known."""
    return limits.resistance_ohm is None or MIN_SKIN_OHM <= limits.resistance_ohm <= MAX_SKIN_OHM


def _check_returns(returns: tuple[tuple[int, ...], ...], electrodes: int, file: str) -> None:
    if len(returns) != electrodes:
        raise FileError(
            file,
            "returns",
            f"{len(returns)} lists for {electrodes} electrodes",
            "give a list for each electrode",
        )
    for electrode, members in enumerate(returns):
        others = set(range(electrodes)) - {electrode}
        if len(set(members)) != len(members) or not others.issuperset(members):
            raise FileError(
                file,
                f"returns[{electrode}]",
                f"it names {list(members)}",
                f"other electrodes, 0 to {electrodes - 1}, each once",
            )
