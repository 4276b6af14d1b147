"""The panels of the live picture: one quantity of all electrodes each.

Owns: brightness and signs of each quantity. Must not know: reports, terminals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

from etd.protocol.messages import ContactState

#: One sign for each kind of contact, in the order of the legend.
CONTACT_SIGNS: dict[ContactState, str] = {
    "closed": "#",
    "soft": "~",
    "open": ".",
    "saturated": "!",
    "shorted": "=",
    "unknown": "?",
}
#: From brightest to black, on a logarithmic scale.
_LEAST_OHM, _MOST_OHM = 3_000, 1_000_000
#: Stabilizers gave from here on, or took up to there; between is neither.
_GAVE, _TOOK = 1.05, 0.95
#: The gain of full brightness; at its inverse it is black.
_BRIGHT_GAIN = 2.0


@dataclass(frozen=True, slots=True)
class Panel:
    """One quantity of all electrodes.

    `bright` has 0..1 for each, None where it is not known. `signs`, if given, are drawn instead of
    blocks. `alarming` electrodes are highlighted.
    """

    title: str
    bright: Sequence[float | None]
    signs: Sequence[str] | None = None
    alarming: frozenset[int] = frozenset()


def contact_panel(states: Sequence[ContactState]) -> Panel:
    bad = {electrode for electrode, state in enumerate(states) if state in ("saturated", "shorted")}
    return Panel(
        "contact",
        [0.6 if state in ("closed", "soft") else 0.0 for state in states],
        [CONTACT_SIGNS[state] for state in states],
        frozenset(bad),
    )


def resistance_panel(resistances_ohm: Sequence[int | None]) -> Panel:
    """The better it conducts, the brighter."""
    return Panel("resistance", [_bright_of_ohm(ohm) for ohm in resistances_ohm])


def gain_panel(gains: Sequence[float | None]) -> Panel:
    """What stabilizers made of the charge that the frame wanted; None where nothing was fired."""
    return Panel(
        "laws: + gave, - took",
        [None if gain is None else _bright_of_gain(gain) for gain in gains],
        ["." if gain is None else _sign_of_gain(gain) for gain in gains],
    )


def _bright_of_ohm(resistance_ohm: int | None) -> float | None:
    if resistance_ohm is None:
        return None
    part = log(resistance_ohm / _LEAST_OHM) / log(_MOST_OHM / _LEAST_OHM)
    return 1.0 - min(1.0, max(0.0, part))


def _bright_of_gain(gain: float) -> float:
    if gain <= 0.0:
        return 0.0
    return min(1.0, max(0.0, 0.5 + 0.5 * log(gain) / log(_BRIGHT_GAIN)))


def _sign_of_gain(gain: float) -> str:
    if gain >= _GAVE:
        return "+"
    return "-" if gain <= _TOOK else "="
