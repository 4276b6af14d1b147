"""A calibration in words: its conditions with their units, and a line for each electrode.

Owns: how each figure is said. Must not know: where a calibration comes from, JSON, terminals.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from etd.cli.doubts import drift_in_words
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.exponent import FittedExponent


def conditions_in_words(conditions: dict[str, object]) -> list[str]:
    """`conditions`: by the key that the file has."""
    return [
        f"{key:<18} {'not given' if value is None else _WORDS.get(key, str)(value)}"
        for key, value in conditions.items()
    ]


def _exponent(fitted: FittedExponent) -> str:
    use = f"may be used with {fitted.board} and its leak of {fitted.leak_ohm} ohm"
    if fitted.why_not is not None:
        use = f"not for this person: {fitted.why_not}"
    return (
        f"k = {fitted.k:.2f} ({fitted.low:.2f} to {fitted.high:.2f}), explains"
        f" {fitted.explained:.0%}, {len(fitted.electrodes)} electrodes in {fitted.states} states of"
        f" the skin, whose resistance changed {fitted.fold:.1f}-fold, {fitted.date.isoformat()}:"
        f" {use}"
    )


def _drift(drift: float) -> str:
    if drift == 0.0:
        return "none, of the first electrode's threshold"
    return f"the first electrode's threshold had {drift_in_words(drift)} when it was asked again"


#: What is not said as it stands, by its key.
_WORDS: dict[str, Callable[[Any], str]] = {
    "width_us": lambda value: f"{value} us",
    "rate_hz": lambda value: f"{value:g} Hz",
    "largest_cap_ua": lambda value: f"{value} uA",
    "skin_celsius": lambda value: f"{value:g} C",
    "false_alarm_rate": lambda value: f"{value:.0%} of the silent trials",
    "is_whole_accepted": lambda _: "yes, all electrodes at once at level 1",
    "drift": _drift,
    "exponent": _exponent,
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
