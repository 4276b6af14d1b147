"""A pattern for `play`: what may be asked of it, and the course from the pattern to its end.

Owns: the options of `play`, the pattern file or object, and what its levels refer to. Must not
know: sockets, when a frame is due (`playing.py`), what is sent (`steps.py`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from etd.client import values
from etd.client.course import Course
from etd.client.playing import Played, Playing
from etd.client.session import Session
from etd.client.steps import Currents, PlayOptions, Report, Step, steps_of
from etd.protocol.calibration import Calibration
from etd.protocol.errors import PatternError, Refused
from etd.protocol.frame import Polarity

if TYPE_CHECKING:
    from etd.files.pattern import Pattern


class PatternOptions(TypedDict, total=False):
    """The options of `play`, as `etd play` has them.

    By default levels are the calibration's, and its rate is the highest; `level` (above 0 to 1)
    plays level 1 as that level. With `current_ua` and `width_us` level 1 is that current, at the
    pattern's rates. `polarity` stands in place of the pattern's. max_rate_hz: the highest rate.
    allow_slower: slow down frames that do not fit. repeat: so many times (default: once, or with
    `seconds` for as long). seconds: ends after so long, silent, whatever the pattern. returns: as a
    frame has them.

    tell is called at once with a sentence for each thing that is played otherwise than the pattern
    says; on_frame with the number of frames shown.
    """

    level: float
    current_ua: int
    width_us: int
    polarity: Polarity
    returns: Literal["all"] | Mapping[str, float]
    max_rate_hz: float
    allow_slower: bool
    repeat: int
    seconds: float
    tell: Callable[[str], None]
    on_frame: Callable[[int], None]


_KNOWN = frozenset(PatternOptions.__annotations__)


def playing_pattern(
    session: Session,
    playing: Playing,
    pattern: Pattern | str | os.PathLike[str],
    options: PatternOptions,
) -> Course[Played]:
    """Raises: PatternError, Refused, DaemonGone."""
    steps = yield from steps_to_play(session, pattern, options, playing.tell)
    seconds = options.get("seconds")
    repeat = options.get("repeat", 1 if seconds is None else None)
    return (yield from playing.playing(steps, repeat, seconds))


def steps_to_play(
    session: Session,
    pattern: Pattern | str | os.PathLike[str],
    options: PatternOptions,
    tell: Report,
) -> Course[list[Step]]:
    """What will be sent; `tell` gets a sentence for each deviation from the pattern. Raises:
    PatternError, Refused.
    """
    _check(options)
    loaded = _loaded(pattern, tell)
    facts = session.facts or (yield session.greet())
    currents = _currents(options, facts.default_rate_hz)
    calibrations: tuple[Calibration, ...] = ()
    if currents is None:
        calibrations = yield from _calibrations(session)
    play_options = PlayOptions(
        level=options.get("level", 1.0),
        currents=currents,
        polarity=options.get("polarity"),
        returns=options.get("returns"),
        max_rate_hz=options.get("max_rate_hz"),
        allows_slower=options.get("allow_slower", False),
    )
    return steps_of(loaded, play_options, facts.array.electrodes, calibrations, tell)


def _check(options: PatternOptions) -> None:
    """Raises: Refused (`bad_message`)."""
    given: dict[str, Any] = {key: value for key, value in options.items() if value is not None}
    for key in given:
        if key not in _KNOWN:
            known = ", ".join(sorted(_KNOWN))
            raise Refused("bad_message", f"play has no option {key!r}; it has {known}")
    if ("current_ua" in given) != ("width_us" in given):
        raise Refused("bad_message", "current_ua and width_us go together: a current needs a width")
    if "current_ua" in given and "level" in given:
        raise Refused("bad_message", "level, or current_ua and width_us: one of the two")
    if not 0 < given.get("level", 1.0) <= 1:
        raise Refused("bad_message", f"level={given['level']!r}: above 0 and at most 1")
    for key in ("seconds", "max_rate_hz"):
        if key in given:
            values.above_zero(key, given[key])
    if "polarity" in given:
        values.check_polarity(values.option("polarity", given["polarity"]))
    if "returns" in given:
        values.check_returns(values.option("returns", given["returns"]))
    repeat = given.get("repeat", 1)
    if isinstance(repeat, bool) or not isinstance(repeat, int) or repeat < 1:
        raise Refused("bad_message", f"repeat={repeat!r}: a whole number from 1 is needed")


def _loaded(pattern: Pattern | str | os.PathLike[str], tell: Report) -> Pattern:
    """Raises: PatternError."""
    # Imported here: a program that plays none does not pay for it.
    from etd.files.pattern import Pattern, check_pattern, load_pattern

    if isinstance(pattern, Pattern):
        return check_pattern(pattern)
    if not isinstance(pattern, (str, os.PathLike)):
        what = f"it is a {type(pattern).__name__}: give an etd.Pattern, or the path of a file"
        raise PatternError("the pattern", None, what)
    loaded, mended = load_pattern(Path(pattern))
    for sentence in mended:
        tell(sentence)
    return loaded


def _currents(options: PatternOptions, default_rate_hz: float) -> Currents | None:
    current_ua, width_us = options.get("current_ua"), options.get("width_us")
    if current_ua is None or width_us is None:
        return None
    return Currents(current_ua, width_us, default_rate_hz)


def _calibrations(session: Session) -> Course[tuple[Calibration, ...]]:
    """What levels refer to. Raises: Refused (`limits_missing`)."""
    names = session.calibration_names
    if not names:
        raise Refused(
            "limits_missing",
            "levels need a calibration: use Display(calibration='NAME'), or give current_ua and"
            " width_us",
        )
    found: list[Calibration] = []
    for name in names:
        calibration: Calibration = yield session.get_calibration(name)
        found.append(calibration)
    return tuple(found)
