"""A calibration in words: its conditions with their units, and a line for each electrode.

Owns: how each figure is said. Must not know: where a calibration comes from, JSON, terminals.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from typing import Any

from etd.cli.doubts import drift_in_words
from etd.files.raises_in_words import raises_in_words
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.exponent import FittedExponent


def conditions_in_words(
    conditions: dict[str, object], calibrated: datetime.date, today: datetime.date
) -> list[str]:
    """`conditions`: by the key that the file has, of a calibration of this day."""
    is_least = conditions.get("is_drift_least") is True
    words: dict[str, Callable[[Any], str]] = {
        **_WORDS,
        "drift": lambda drift: _drift(drift, is_least),
        "exponent": lambda fitted: _exponent(fitted, calibrated, today),
        "adaptation": lambda found: _adaptation(found, calibrated, today),
    }
    return [
        f"{key:<18} {'not given' if value is None else words.get(key, str)(value)}"
        for key, value in conditions.items()
    ]


def k_in_words(fitted: FittedExponent) -> str:
    """k, its interval, and what it explains of what: a figure that was not kept is not said."""
    k = f"k = {fitted.k:.2f} ({fitted.low:.2f} to {fitted.high:.2f})"
    of = f"thresholds of {len(fitted.electrodes)} electrodes did in {fitted.states} states"
    timeless = f"{fitted.explained:.0%} of what a line over time leaves of"
    if fitted.explained_of_all is None:
        return f"{k}; it explains {timeless} what {of}"
    return (
        f"{k}; it explains {fitted.explained_of_all:.0%} of all that {of}, and {timeless} it;"
        f" the skin's resistance changed {fitted.fold:.1f}-fold"
    )


def _exponent(fitted: FittedExponent, calibrated: datetime.date, today: datetime.date) -> str:
    use = f"may be used with {fitted.board} and its leak of {fitted.leak_ohm} ohm"
    if (why := fitted.why_not_in(calibrated)) is not None:
        use = f"not for this person: {why}"
    elif (doubt := fitted.why_not_in(calibrated, today)) is not None:
        use = f"{use}, in doubt: {doubt}"
    silent = ""
    if fitted.false_alarm_rate is not None:
        silent = f"; {_alarms(fitted.false_alarm_rate)} were felt"
    return f"{k_in_words(fitted)}{silent}; {fitted.date.isoformat()}: {use}"


def _adaptation(found: MeasuredAdaptation, calibrated: datetime.date, today: datetime.date) -> str:
    why = found.why_not_in(calibrated)
    follows = raises_in_words(why, found)
    if why is None and (doubt := found.why_not_in(calibrated, today)) is not None:
        follows = f"{follows}, in doubt: {doubt}"
    return f"{found.in_words}; {found.date.isoformat()}: {follows}"


def _alarms(rate: float) -> str:
    return f"{rate:.0%} of the silent trials"


def _drift(drift: float, is_least: bool) -> str:
    if drift == 0.0 and not is_least:
        return "none, of the first electrode's threshold"
    said = drift_in_words(drift, is_least=is_least)
    return f"the first electrode's threshold had {said} when it was asked again"


#: What is not said as it stands, by its key.
_WORDS: dict[str, Callable[[Any], str]] = {
    "width_us": lambda value: f"{value} us",
    "rate_hz": lambda value: f"{value:g} Hz",
    "largest_cap_ua": lambda value: f"{value} uA",
    "skin_celsius": lambda value: f"{value:g} C",
    "false_alarm_rate": _alarms,
    "modelled": lambda _: "made on a fake board: no person felt it, and only a fake board plays it",
    "is_whole_accepted": lambda _: "yes, all electrodes at once at level 1",
    "is_drift_least": lambda _: "yes, it was not felt any more up to its cap",
}


def table_of(calibration: Calibration) -> list[str]:
    lines = ["electrode  threshold  comfortable  cap (uA)       resistance"]
    for electrode, limits in enumerate(calibration.electrode):
        ohm = "not known" if limits.resistance_ohm is None else f"{limits.resistance_ohm} ohm"
        said = "".join(f"  {words}" for words in _remarks(limits))
        lines.append(
            f"{electrode:>9}  {limits.threshold_ua:>9}  {limits.comfortable_ua:>11}"
            f"  {limits.cap_ua:>8}  {ohm:>15}{said}"
        )
    return lines


def _remarks(limits: ElectrodeLimits) -> list[str]:
    found = []
    if not limits.felt:
        found.append("not felt")
    if limits.felt_from_ua is not None:
        found[-1] += f" within its cap, felt from {limits.felt_from_ua} uA on"
    if limits.quality is not None:
        found.append(limits.quality)
    if limits.place is not None:
        found.append(_PLACES[limits.place])
    if limits.date is not None:
        found.append(f"of {limits.date.isoformat()}")
    if limits.threshold_date is not None:
        found.append(f"threshold and cap of {limits.threshold_date.isoformat()}")
    return found


_PLACES = {
    "under": "under the electrode",
    "around": "around the electrode",
    "elsewhere": "elsewhere",
}
