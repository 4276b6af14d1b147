"""A person's calibration: what each electrode may carry, and where feeling begins.

Owns: the file type, its loader and writer, its rules, and the level map (threshold to comfortable).
Must not know: where a level comes from, boards, time.

A calibration belongs to a participant code (never a name) and to every condition it was made
under; a `level` frame that departs from them is refused, except for a lower rate.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.errors import Refused
from etd.protocol.exponent import FittedExponent
from etd.protocol.frame import Frame, Name, PerElectrode, Polarity, Returns, ShortText
from etd.pulse.measured import MAX_SKIN_OHM, MIN_SKIN_OHM
from etd.stabilize.shape import PLAIN, Shape
from etd_hal.errors import FileError

Ua = Annotated[int, Meta(ge=0, le=10_000)]
#: Of a random order.
MOST_SEED = 2**31 - 1
#: By what part of themselves thresholds rose: -1 is to nothing.
Drift = Annotated[float, Meta(ge=-1, le=1_000)]
SkinCelsius = Annotated[float, Meta(ge=5, le=45)]
Seed = Annotated[int, Meta(ge=0, le=MOST_SEED)]
#: What a person says of an electrode at its comfortable level: what it feels like, and where.
Quality = Literal["vibration", "pressure", "prickling", "other"]
Place = Literal["under", "around", "elsewhere"]
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
    #: Where `felt` is false because its cap was taken down with the whole array's: its threshold,
    #: which is above the cap.
    felt_from_ua: Ua | None = None
    #: Where it differs from the file's date: the day on which the values were found.
    date: datetime.date | None = None
    #: Where threshold and cap are an earlier day's than the rest, which was matched to a reference.
    threshold_date: datetime.date | None = None
    #: Where they were asked.
    quality: Quality | None = None
    place: Place | None = None


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A person's electrodes under stated conditions (DESIGN section 7)."""

    participant: Name
    body_site: ShortText
    array: ShortText
    polarity: Polarity
    width_us: Annotated[int, Meta(ge=20, le=200)]
    rate_hz: Annotated[float, Meta(ge=0.1, le=200)]
    returns: Returns
    date: datetime.date
    program: ShortText
    electrode: Annotated[tuple[ElectrodeLimits, ...], PerElectrode]
    #: I = threshold + (comfortable - threshold) x level^(1/gamma)
    gamma: Annotated[float, Meta(ge=0.5, le=3.0)] = 1.0
    #: Made on a fake board: no current of it was felt by a person, and only a fake board plays it.
    modelled: Literal[True] | None = None
    #: How thresholds were found, and the number of pulses in a presentation.
    method: Method | None = None
    pulses: Annotated[int, Meta(ge=1, le=1_000)] | None = None
    #: The shape that the body site gave every pulse then. A file without it was made with plain
    #: pulses.
    shape: Shape = PLAIN
    #: Of the random order of electrodes and catch trials. Absent, as all that follows: not known.
    seed: Seed | None = None
    #: Silent trials, and the part of them that was said to be felt.
    catch_trials: Annotated[int, Meta(ge=1)] | None = None
    false_alarm_rate: Annotated[float, Meta(ge=0, le=1)] | None = None
    #: All electrodes at once, at level 1, were presented in the end and not too strong.
    is_whole_accepted: Literal[True] | None = None
    #: By how much the threshold of the first electrode had changed when it was last asked again.
    drift: Drift | None = None
    #: It was not felt any more up to its cap, so that its threshold has risen by that or more.
    is_drift_least: Literal[True] | None = None
    #: Of the skin under the array, as noted by the operator.
    skin_celsius: SkinCelsius | None = None
    #: How far this person's thresholds follow the resistance, for `power_law`.
    exponent: FittedExponent | None = None
    #: Whether this person feels less and less in use, for what their word may raise.
    adaptation: MeasuredAdaptation | None = None

    @property
    def unfelt(self) -> tuple[int, ...]:
        """The electrodes on which a level above 0 has no meaning."""
        return tuple([number for number, limits in enumerate(self.electrode) if not limits.felt])


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
    if len(levels) != len(calibration.electrode):
        raise ValueError(f"{len(levels)} levels for {len(calibration.electrode)} electrodes")
    return tuple(
        current_of_felt(calibration, electrode, level) if level > 0.0 else 0
        for electrode, level in enumerate(levels)
    )


def current_of_felt(calibration: Calibration, electrode: int, level: float) -> int:
    """The current of a level above 0 at one electrode, in uA.

    Raises: Refused (`level_needs_calibration`).
    """
    limits = calibration.electrode[electrode]
    if not limits.felt:
        why = "was not felt when it was calibrated (felt = false,"
        if limits.felt_from_ua is not None:
            why = (
                f"is felt from {limits.felt_from_ua} uA on, above its cap of {limits.cap_ua} uA,"
                " which was taken down where something was too strong (felt = false,"
            )
        raise Refused(
            "level_needs_calibration",
            f"electrode {electrode} {why} {calibration.polarity}), so a level has no meaning there:"
            " leave it out (level 0), or calibrate it again",
            electrode,
        )
    return current_of_level(limits, level, calibration.gamma)


def check_conditions_of_levels(
    calibration: Calibration,
    frame: Frame,
    most_hz: float,
    others: Sequence[Calibration] = (),
) -> None:
    """A level frame must have the conditions of its calibration, or a lower rate: fewer pulses of
    the same current never feel stronger. `most_hz` is the highest rate here. `others` are the
    calibrations of other polarities, which have all other conditions in common. Raises: Refused.
    """
    made_with: dict[str, tuple[object, ...]] = {
        "polarity": (calibration.polarity, *(other.polarity for other in others)),
        "width_us": (calibration.width_us,),
        "returns": (calibration.returns,),
    }
    for key, made in made_with.items():
        asked = getattr(frame, key)
        if asked is None or asked in made:
            continue
        is_each = key != "returns" and isinstance(asked, tuple)
        if is_each and all(entry in made for entry in asked):
            continue
        raise Refused(
            "bad_frame",
            f"level means what it was calibrated to with {key} {' or '.join(map(str, made))}; the"
            " frame asks for"
            f" another {key}: leave it out, or calibrate for it{_or_current(others)}",
        )
    fastest_hz = max(_rates_hz(frame), default=0.0)
    if fastest_hz > calibration.rate_hz:
        raise _too_fast_for_levels(calibration.rate_hz, fastest_hz, most_hz)


def _or_current(others: Sequence[Calibration]) -> str:
    """Advice: with a calibration for each polarity, caps hold for these alone."""
    return "" if others else ", or send current_ua"


def _too_fast_for_levels(made_hz: float, asked_hz: float, most_hz: float) -> Refused:
    """Pulses that follow faster add up to more than the person has accepted."""
    other = f"no frame here may have more than {most_hz:g}"
    if asked_hz <= most_hz:
        other = (
            f"or calibrate with rate_hz {asked_hz:g}, whose levels hold at all lower rates, or send"
            " current_ua"
        )
    return Refused(
        "bad_frame",
        f"level means what it was calibrated to with rate_hz {made_hz:g}, and may be had at lower"
        f" rates too; the frame asks for {asked_hz:g}: leave it out or ask for at most"
        f" {min(made_hz, most_hz):g}; {other}",
    )


def levels_hz_of(calibration: Calibration | None, frame: Frame) -> float | None:
    """The rate of the calibration, in Hz, of a level frame."""
    return None if calibration is None or frame.level is None else calibration.rate_hz


def lower_than_calibrated(calibration: Calibration | None, frame: Frame) -> float | None:
    """The same, where the frame asks for a lower one."""
    made_hz = levels_hz_of(calibration, frame)
    if made_hz is None:
        return None
    return made_hz if min(_rates_hz(frame), default=made_hz) < made_hz else None


def _rates_hz(frame: Frame) -> tuple[float, ...]:
    """Those that it asks for."""
    rate_hz = frame.rate_hz
    if rate_hz is None:
        return ()
    return rate_hz if isinstance(rate_hz, tuple) else (rate_hz,)


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
    """Threshold, comfortable and cap must rise, explicit returns and the electrodes of an exponent
    must exist, and the resistance must be one that skin can have.

    Raises: FileError.
    """
    if isinstance(calibration.returns, tuple):
        _check_returns(calibration.returns, len(calibration.electrode), file)
    if calibration.exponent is not None:
        _check_electrodes_of(calibration.exponent, len(calibration.electrode), file)
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
        if not is_felt_above_cap(limits):
            raise FileError(
                file,
                f"electrode[{index}].felt_from_ua",
                f"{limits.felt_from_ua} uA with felt = {str(limits.felt).lower()} and a cap of"
                f" {limits.cap_ua} uA",
                "it is the threshold of an electrode that is not felt within its cap: above the"
                " cap, with felt = false; else leave it out",
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


def is_felt_above_cap(limits: ElectrodeLimits) -> bool:
    """Whether `felt_from_ua` is what it is for, or is not given."""
    felt_from_ua = limits.felt_from_ua
    return felt_from_ua is None or (not limits.felt and felt_from_ua > limits.cap_ua)


def resisted_as_skin(limits: ElectrodeLimits) -> bool:
    """Whether the resistance is one that skin can have, or is not known."""
    return limits.resistance_ohm is None or MIN_SKIN_OHM <= limits.resistance_ohm <= MAX_SKIN_OHM


def _check_electrodes_of(exponent: FittedExponent, electrodes: int, file: str) -> None:
    named = exponent.electrodes
    if len(set(named)) != len(named) or not set(range(electrodes)).issuperset(named):
        raise FileError(
            file,
            "exponent.electrodes",
            f"it names {list(named)}",
            f"electrodes of the array, 0 to {electrodes - 1}, each once",
        )


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
