"""A person's exponent k, fitted to thresholds of a few electrodes in several states of the skin.

Owns: the fit, its interval, and what it cannot be made from. Must not know: how thresholds are
found, how the skin is changed, files.

    log threshold = own(electrode) - k x log R + drift x time

*Within* electrodes: between them, thresholds and resistances differ for other reasons, and the
slope over the electrodes of one calibration was found in half of the fingers that had none. The
drift is common to all, since a person adapts while the states follow one another; it can be told
from the resistance only where that goes both ways. The errors of one state are taken to be alike
(a person's criterion moves), so the interval is the wider one of two: by all residuals, and by the
mean residuals of states, of which own, k and drift leave three fewer than there are states.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.protocol.errors import EtdError
from etd.protocol.exponent import LEAST_ELECTRODES, LEAST_FOLD, MOST_SAID, FittedExponent

#: In three states the drift cannot be told from a criterion that moved: 4 to 10 % of modelled
#: persons without a k got one.
LEAST_STATES = 4
#: Of the resistance's variation within electrodes, what time must leave.
_LEAST_APART = 0.2
_DIGITS = 4
#: Student's t, 95 % at one end, so 90 % of both, by degrees of freedom; above these as for ten. A k
#: at or below zero is refused anyhow, so that who has none can get one at one end only, by one
#: chance in twenty.
_T = (math.inf, 6.31, 2.92, 2.35, 2.13, 2.02, 1.94, 1.89, 1.86, 1.83, 1.81)


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The threshold of one electrode in one state, and the resistance then, as at no current:
    thresholds differ, and skin resists less at higher ones.
    """

    electrode: int
    state: int
    at_s: float
    threshold_ua: Annotated[float, Meta(gt=0, le=1e6)]
    resistance_ohm: Annotated[float, Meta(gt=0, le=1e9)]


class NoFit(EtdError):
    """Nothing can be fitted; the message says what to do."""


def fitted(
    asked: Sequence[Asked], date: datetime.date, board: str, leak_ohm: int
) -> FittedExponent:
    """k with its 90 % interval, as measured with this board, and how much it explains: of what a
    line over time leaves of the thresholds, and of all that they did within electrodes, where what
    they did with time is not explained. Whether it can be used, it says itself.

    Raises: NoFit, where states or electrodes are too few, or too alike, or nothing is known of k.
    """
    electrodes = tuple(sorted({one.electrode for one in asked}))
    states = tuple(sorted({one.state for one in asked}))
    _check_enough(asked, electrodes, states)
    fold = _fold(asked, electrodes)
    if fold < LEAST_FOLD:
        raise NoFit(
            f"the skin resisted only {fold:.1f} times as much in one state as in another, and"
            f" {LEAST_FOLD:g} times are needed: breathe on the array longer, or let it dry longer"
        )
    threshold = _within(asked, lambda one: math.log(one.threshold_ua))
    resistance = _within(asked, lambda one: math.log(one.resistance_ohm))
    time = _within(asked, lambda one: one.at_s)
    timeless, left = _without(threshold, time), _without(resistance, time)
    spread = _dot(left, left)
    if spread < _LEAST_APART * _dot(resistance, resistance):
        raise NoFit(
            "the resistance changed one way all the time, so that it cannot be told from a person"
            " who adapts: let the skin become dry again between two states"
        )
    slope = _dot(left, timeless) / spread
    residuals = [now - slope * at for now, at in zip(timeless, left, strict=True)]
    half = _half_interval(asked, len(electrodes), states, left, residuals)
    if not abs(slope) + half <= MOST_SAID:
        raise NoFit(
            f"thresholds went up and down so much that nothing is known of k ({-slope:.3g}, within"
            f" {half:.3g}): answer by the same feeling in each state"
        )
    by_k = [now - slope * at for now, at in zip(threshold, resistance, strict=True)]
    return FittedExponent(
        k=round(-slope, _DIGITS),
        low=round(-slope - half, _DIGITS),
        high=round(-slope + half, _DIGITS),
        explained=_explained(timeless, residuals),
        explained_of_all=_explained(threshold, by_k),
        electrodes=electrodes,
        states=len(states),
        fold=round(fold, _DIGITS),
        date=date,
        board=board,
        leak_ohm=leak_ohm,
    )


def _check_enough(
    asked: Sequence[Asked], electrodes: tuple[int, ...], states: tuple[int, ...]
) -> None:
    if len(states) < LEAST_STATES or len(electrodes) < LEAST_ELECTRODES:
        raise NoFit(
            f"{len(electrodes)} electrodes in {len(states)} states of the skin: at least"
            f" {LEAST_ELECTRODES} in {LEAST_STATES} are needed"
        )
    for electrode in electrodes:
        own = sum(one.electrode == electrode for one in asked)
        if own < LEAST_STATES:
            raise NoFit(
                f"electrode {electrode} has a threshold in {own} states, and {LEAST_STATES} are"
                " needed: leave it out"
            )


def _half_interval(
    asked: Sequence[Asked],
    electrodes: int,
    states: tuple[int, ...],
    left: Sequence[float],
    residuals: Sequence[float],
) -> float:
    """The errors of one state are alike, so that they count by states: the residuals of all would
    make much of what was asked six times."""
    free = len(asked) - electrodes - 2
    by_all = math.sqrt(_dot(residuals, residuals) / free / _dot(left, left))
    rests, changes = _means(asked, states, residuals), _means(asked, states, left)
    spread, free_states = _dot(changes, changes), len(states) - 3
    if spread <= 0.0:
        return math.inf
    by_states = math.sqrt(_dot(rests, rests) / free_states / spread)
    return max(_t(free) * by_all, _t(free_states) * by_states)


def _means(asked: Sequence[Asked], states: tuple[int, ...], values: Sequence[float]) -> list[float]:
    """By state, of the electrodes that have a threshold in it."""
    of_state: dict[int, list[float]] = {state: [] for state in states}
    for one, value in zip(asked, values, strict=True):
        of_state[one.state].append(value)
    return [sum(own) / len(own) for own in of_state.values()]


def _t(free: int) -> float:
    return _T[min(free, len(_T) - 1)]


def _fold(asked: Sequence[Asked], electrodes: tuple[int, ...]) -> float:
    """The median over electrodes of the largest resistance by the smallest."""
    folds = []
    for electrode in electrodes:
        seen = [one.resistance_ohm for one in asked if one.electrode == electrode]
        folds.append(max(seen) / min(seen))
    return sorted(folds)[len(folds) // 2] if len(folds) % 2 else _middle(sorted(folds))


def _middle(folds: list[float]) -> float:
    at = len(folds) // 2
    return math.sqrt(folds[at - 1] * folds[at])


def _within(asked: Sequence[Asked], value: Callable[[Asked], float]) -> list[float]:
    """Less the mean of the same electrode."""
    means: dict[int, list[float]] = {}
    for one in asked:
        means.setdefault(one.electrode, []).append(value(one))
    return [value(one) - sum(means[one.electrode]) / len(means[one.electrode]) for one in asked]


def _without(values: Sequence[float], other: Sequence[float]) -> list[float]:
    """What a straight line over `other` leaves of them."""
    spread = _dot(other, other)
    slope = _dot(values, other) / spread if spread > 0.0 else 0.0
    return [value - slope * at for value, at in zip(values, other, strict=True)]


def _explained(values: Sequence[float], residuals: Sequence[float]) -> float:
    """The part of their variation that is not in the residuals; none, where these vary more."""
    whole = _dot(values, values)
    explained = 1.0 - _dot(residuals, residuals) / whole if whole > 0.0 else 0.0
    return round(max(0.0, explained), _DIGITS)


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))
