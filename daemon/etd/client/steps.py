"""Converts a pattern into steps: values and options of each frame, and its duration.

Owns: levels and currents, rates and polarities, and what of a file cannot be played. Must not know:
sockets, time, the terminal.

With levels, width and polarity are the calibration's, and its rate is the highest: levels hold for
its conditions, and for lower rates. Of several calibrations, that of a frame's polarity holds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from etd.client.options import FrameOptions
from etd.protocol.calibration import Calibration, currents_of_levels
from etd.protocol.calibration_set import polarities_in_words
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity

if TYPE_CHECKING:
    from etd.files.pattern import Pattern, PatternFrame

Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Currents:
    """Play levels as fractions of `current_ua`, for `width_us`, at the file's rate and polarity."""

    current_ua: int
    width_us: int
    default_rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayOptions:
    """How a pattern is played; `polarity` None leaves it to the file."""

    level: float = 1.0
    currents: Currents | None = None
    polarity: Polarity | None = None
    returns: Literal["all"] | Mapping[str, float] | None = None
    max_rate_hz: float | None = None
    allows_slower: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One frame as it is sent, `duration_ms` long. `largest_ua` is its highest current.

    A frame of the file that ends in silence makes two steps; the second one `ends_frame`.
    """

    kind: Literal["level", "current_ua"]
    numbers: tuple[float, ...]
    options: FrameOptions
    duration_ms: int
    largest_ua: int
    ends_frame: bool = True


def steps_of(
    pattern: Pattern,
    play_options: PlayOptions,
    electrodes: int,
    calibrations: Sequence[Calibration],
    tell: Report,
) -> list[Step]:
    """All steps of a pattern on an array of `electrodes`. `tell` gets a sentence for each deviation
    from the file. `calibrations` of the lease; none where currents are played.

    Raises: Refused, for what cannot be played.
    """
    if pattern.electrodes != electrodes:
        raise Refused(
            "bad_frame",
            f"the pattern is for {pattern.electrodes} electrodes, this array has {electrodes}",
        )
    if play_options.currents is not None:
        _report_lower_rates(pattern, play_options, tell)
    elif calibrations:
        _check_polarity(pattern, play_options, calibrations)
        _report_rates(pattern, play_options, calibrations[0], tell)
    return [
        step
        for tag, frame in enumerate(pattern.frames)
        for step in _frame_steps(tag, frame, play_options, calibrations)
    ]


def silent(step: Step, duration_ms: int) -> Step:
    """The same frame without stimulation."""
    zeros = (0,) * len(step.numbers)
    return replace(step, numbers=zeros, duration_ms=duration_ms, largest_ua=0, ends_frame=True)


def _frame_steps(
    tag: int,
    frame: PatternFrame,
    play_options: PlayOptions,
    calibrations: Sequence[Calibration],
) -> list[Step]:
    options: FrameOptions = {"tag": tag}
    if play_options.returns is not None:
        options["returns"] = play_options.returns
    if play_options.allows_slower:
        options["allow_slower"] = True
    numbers: tuple[float, ...]
    if play_options.currents is None:
        numbers = tuple(value * play_options.level for value in frame.level)
        in_ua = _of_levels(frame, play_options, calibrations, numbers, options)
    else:
        numbers = in_ua = _currents_ua(frame, play_options, play_options.currents, options)
    step = Step(
        kind="level" if play_options.currents is None else "current_ua",
        numbers=numbers,
        options=options,
        duration_ms=frame.duration_ms,
        largest_ua=max(in_ua),
        ends_frame=not frame.off_ms,
    )
    return [step] if step.ends_frame else [step, silent(step, frame.off_ms)]


def _of_levels(
    frame: PatternFrame,
    play_options: PlayOptions,
    calibrations: Sequence[Calibration],
    levels: tuple[float, ...],
    options: FrameOptions,
) -> tuple[int, ...]:
    """The options get the rate, where it is not the calibration's, and which calibration holds."""
    if not calibrations:
        return (0,)
    polarity = play_options.polarity or frame.polarity or calibrations[0].polarity
    calibration = next(it for it in calibrations if it.polarity == polarity)
    if len(calibrations) > 1:
        options["polarity"] = polarity
    rate_hz = _level_rate_hz(frame, play_options, calibration)
    if rate_hz is not None:
        options["rate_hz"] = rate_hz
    return currents_of_levels(calibration, levels)


def _currents_ua(
    frame: PatternFrame, play_options: PlayOptions, currents: Currents, options: FrameOptions
) -> tuple[int, ...]:
    """The options get rate, width and polarity."""
    rate_hz = frame.rate_hz or currents.default_rate_hz
    options["rate_hz"] = min(rate_hz, play_options.max_rate_hz or rate_hz)
    options["width_us"] = currents.width_us
    polarity = play_options.polarity or frame.polarity
    if polarity is not None:
        options["polarity"] = polarity
    return tuple(round(level * currents.current_ua) for level in frame.level)


def _report_lower_rates(pattern: Pattern, play_options: PlayOptions, tell: Report) -> None:
    most_hz = play_options.max_rate_hz
    if most_hz is None:
        return
    faster = sum(1 for frame in pattern.frames if (frame.rate_hz or 0.0) > most_hz)
    if faster:
        tell(f"{faster} frames have more than {most_hz:g} Hz and are played at {most_hz:g} Hz")


def _check_polarity(
    pattern: Pattern, play_options: PlayOptions, calibrations: Sequence[Calibration]
) -> None:
    known = {None, *(calibration.polarity for calibration in calibrations)}
    asked = {play_options.polarity or frame.polarity for frame in pattern.frames}
    others = sorted(polarity for polarity in asked - known if polarity is not None)
    if others:
        raise Refused(
            "bad_frame",
            f"the pattern has {others[0]} pulses, and the calibration was made with"
            f" {polarities_in_words(calibrations)} ones: play with --current-ua and --width-us, or"
            f" with a calibration made with {others[0]} pulses",
        )


def _level_rate_hz(
    frame: PatternFrame, play_options: PlayOptions, calibration: Calibration
) -> float | None:
    """The file's rate, or the highest allowed, if it is below the calibration's; else None."""
    made_hz = calibration.rate_hz
    rate_hz = min(frame.rate_hz or made_hz, play_options.max_rate_hz or made_hz)
    return rate_hz if rate_hz < made_hz else None


def _report_rates(
    pattern: Pattern, play_options: PlayOptions, calibration: Calibration, tell: Report
) -> None:
    made_hz, most_hz = calibration.rate_hz, play_options.max_rate_hz
    asked = {frame.rate_hz for frame in pattern.frames} - {None}
    faster = sorted(rate_hz for rate_hz in asked if rate_hz is not None and rate_hz > made_hz)
    if faster:
        lowered_hz = min(made_hz, most_hz or made_hz)
        tell(
            f"the file has {', '.join(f'{value:g}' for value in faster)} Hz; levels are played at"
            f" {lowered_hz:g} Hz, the calibration has {made_hz:g} Hz (with a current and a width:"
            " at the file's)"
        )
    slower = {_level_rate_hz(frame, play_options, calibration) for frame in pattern.frames} - {None}
    if slower:
        rates = ", ".join(f"{value:g}" for value in sorted(value for value in slower if value))
        tell(
            f"levels are played at {rates} Hz, below the calibration's {made_hz:g} Hz: they may be"
            " felt less, or not at all near the threshold"
        )
