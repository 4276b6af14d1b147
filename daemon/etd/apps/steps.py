"""Converts a pattern into steps: values and options of each frame, and its duration.

Owns: levels and currents, rates and polarities, and what of a file cannot be played. Must not know:
sockets, time, the terminal.

With levels, rate, width and polarity are the calibration's: levels hold for its conditions only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from etd.client import FrameOptions
from etd.files.pattern import Pattern, PatternFrame
from etd.protocol.calibration import Calibration, currents_of_levels
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity

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
    calibration: Calibration | None,
    tell: Report,
) -> list[Step]:
    """All steps of a pattern on an array of `electrodes`. `tell` gets a sentence for each deviation
    from the file. Raises: Refused, for what cannot be played.
    """
    if pattern.electrodes != electrodes:
        raise Refused(
            "bad_frame",
            f"the pattern is for {pattern.electrodes} electrodes, this array has {electrodes}",
        )
    if play_options.currents is not None:
        _report_lower_rates(pattern, play_options, tell)
    elif calibration is not None:
        _check_polarity(pattern, play_options, calibration)
        _check_rate(pattern, play_options, calibration, tell)
    return [
        step
        for tag, frame in enumerate(pattern.frames)
        for step in _frame_steps(tag, frame, play_options, calibration)
    ]


def silent(step: Step, duration_ms: int) -> Step:
    """The same frame without stimulation."""
    zeros = (0,) * len(step.numbers)
    return replace(step, numbers=zeros, duration_ms=duration_ms, largest_ua=0, ends_frame=True)


def _frame_steps(
    tag: int, frame: PatternFrame, play_options: PlayOptions, calibration: Calibration | None
) -> list[Step]:
    options: FrameOptions = {"tag": tag}
    if play_options.returns is not None:
        options["returns"] = play_options.returns
    if play_options.allows_slower:
        options["allow_slower"] = True
    numbers: tuple[float, ...]
    if play_options.currents is None:
        numbers = tuple(value * play_options.level for value in frame.level)
        in_ua = (0,) if calibration is None else currents_of_levels(calibration, numbers)
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


def _check_polarity(pattern: Pattern, play_options: PlayOptions, calibration: Calibration) -> None:
    asked = {play_options.polarity or frame.polarity for frame in pattern.frames}
    others = sorted(
        polarity for polarity in asked if polarity is not None and polarity != calibration.polarity
    )
    if others:
        raise Refused(
            "bad_frame",
            f"the pattern has {others[0]} pulses, and the calibration was made with"
            f" {calibration.polarity} ones: play with --current-ua and --width-us, or with a"
            f" calibration made with {others[0]} pulses",
        )


def _check_rate(
    pattern: Pattern, play_options: PlayOptions, calibration: Calibration, tell: Report
) -> None:
    rate_hz = calibration.rate_hz
    if play_options.max_rate_hz is not None and rate_hz > play_options.max_rate_hz:
        raise Refused(
            "bad_frame",
            f"levels are played at the calibration's {rate_hz:g} Hz, which is above --max-rate"
            f" {play_options.max_rate_hz:g}: play with --current-ua and --width-us",
        )
    asked = {frame.rate_hz for frame in pattern.frames}
    others = sorted(value for value in asked if value is not None and value != rate_hz)
    if others:
        tell(
            f"the file has {', '.join(f'{value:g}' for value in others)} Hz; levels are played at"
            f" the calibration's {rate_hz:g} Hz (with --current-ua: at the file's)"
        )
