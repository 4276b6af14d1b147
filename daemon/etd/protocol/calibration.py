"""A person's calibration: what each electrode may carry, and where feeling begins.

Owns: the file type, its loader and writer, its rules, and the level map (threshold to
comfortable). Must not know: who asks for a level, boards, time.

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
from etd.protocol.frame import Polarity, Returns
from etd.stabilize.max_age import MAX_SKIN_OHM, MIN_SKIN_OHM
from etd.stabilize.shape import PLAIN, Shape
from etd_hal.errors import FileError

Ua = Annotated[int, Meta(ge=0, le=10_000)]
Method = Literal["limits", "staircase", "quest-plus", "equalize"]


class ElectrodeLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One electrode: first feeling, comfortable level, and the cap that is never passed."""

    threshold_ua: Ua
    comfortable_ua: Ua
    cap_ua: Ua
    #: Of a contact with skin: `check_order` refuses what none is believed to have.
    resistance_ohm: int | None = None
    #: False: nothing was felt up to the cap, or nothing was tried; then the three are bounds only.
    felt: bool = True
    #: Where it is another day's than the file's: found on that day, or taken over from then.
    date: datetime.date | None = None
    #: Where threshold and cap are an earlier day's than the rest, which was matched to a reference.
    threshold_date: datetime.date | None = None


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
    #: How thresholds were found, and of how many pulses a presentation was.
    method: Method | None = None
    pulses: Annotated[int, Meta(ge=1, le=1_000)] | None = None
    #: What the body site made of every pulse then. A file that says nothing is of plain pulses:
    #: there was nothing else when such files were made.
    shape: Shape = PLAIN
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


def currents_of_levels(calibration: Calibration, levels: Sequence[float]) -> tuple[int, ...]:
    """The same for all electrodes. One that was not felt has neither threshold nor comfortable
    level: its figures are bounds, and no level stands for anything there.

    Raises: Refused (`level_needs_calibration`).
    """
    for electrode, (limits, level) in enumerate(zip(calibration.electrode, levels, strict=True)):
        if level > 0.0 and not limits.felt:
            raise Refused(
                "level_needs_calibration",
                f"electrode {electrode} was not felt when it was calibrated (felt = false), so no"
                " level stands for anything there: leave it out (level 0), or calibrate it again",
                electrode,
            )
    return tuple(
        current_of_level(limits, level, calibration.gamma)
        for limits, level in zip(calibration.electrode, levels, strict=True)
    )


def check_shape_of_levels(calibration: Calibration, shape: Shape) -> None:
    """A level means what it was calibrated to: the body site must make the same of a pulse still.

    Raises: Refused (`bad_frame`).
    """
    made_with, now = (made.at(calibration.width_us) for made in (calibration.shape, shape))
    if made_with != now:
        raise Refused(
            "bad_frame",
            f"level means what it was calibrated to, which is {made_with}; the body site's"
            f" [stabilize] now makes {now} of it: put that back, calibrate anew, or open"
            " with limits and send current_ua",
        )


def check_shape_of_caps(calibration: Calibration, shape: Shape) -> None:
    """A cap was accepted with what led into its pulses and how many came: with a prepulse, a probe
    or bursts that were not there it would let through more than was tried. `narrow` is left to
    levels: pulses of a current that it would make stronger are refused when they are planned.

    Raises: Refused (`bad_frame`).
    """
    made_with, now = (replace(made, strength_duration=None) for made in (calibration.shape, shape))
    if made_with != now:
        raise Refused(
            "bad_frame",
            f"the calibration's caps were accepted with {made_with}; the body site's [stabilize]"
            f" now makes {now} of a frame: put that back, calibrate anew, or open with limits"
            " instead of the calibration",
        )


def check_order(calibration: Calibration, file: str) -> Calibration:
    """Threshold, comfortable and cap must rise, explicit returns must be there, and what resisted
    must have been skin.

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
                f"it says {limits.resistance_ohm}, and no contact with skin resists so"
                f" {'little' if (limits.resistance_ohm or 0) < MIN_SKIN_OHM else 'much'}",
                f"give a whole number from {MIN_SKIN_OHM:.0f} to {MAX_SKIN_OHM:.0f}, as a pulse"
                " told it;"
                " where none did, leave it out: laws by resistance then go by the beginning",
            )
    return calibration


def resisted_as_skin(limits: ElectrodeLimits) -> bool:
    """Or is not known: no pulse tells what lies outside of what is believed of skin."""
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
