"""Where a threshold lies, by all answers so far: a Bayesian filter over a grid.

Owns: the prior, the psychometric function, and how a threshold moves between presentations. Must
not know: procedures, persons, daemons.

The function [design]: felt with probability 1/2 at the threshold but for guesses and lapses, over
the logarithm of the current by a logistic function. Its spread, guesses and lapses are not known,
so each combination is carried along. Between two presentations the threshold may move by a
percent or so: older answers count for less, and what is estimated is the threshold of now.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from math import exp, log, sqrt

_LEAST_UA, _MOST_UA = 15.0, 14_000.0
_STEP = 0.025
#: The standard deviation of how far a threshold moves from one presentation to the next.
_MOVES = 0.01
#: Of the logistic function: from one felt in ten to nine in ten it takes 4.4 times this.
_SPREADS = (0.02, 0.04, 0.08)
#: Felt far below the threshold, and missed far above it.
_GUESSES = (0.02, 0.12, 0.30)
_LAPSES = (0.04,)


class ThresholdEstimate:
    """Of one electrode. All currents within the grid are as likely before the first answer."""

    def __init__(self) -> None:
        count = len(_grid())
        self._likely = [[1.0] * count for _ in _functions()]
        self._normalize()

    def update(self, current_ua: float, *, is_felt: bool) -> None:
        """By the answer to a presentation of this current."""
        chances = _chances(round(log(current_ua) / _STEP), is_felt)
        self._likely = [
            _moved([one * chance for one, chance in zip(each, of_each, strict=True)])
            for each, of_each in zip(self._likely, chances, strict=True)
        ]
        self._normalize()

    @property
    def threshold_ua(self) -> float:
        """The median."""
        total = 0.0
        for place, likely in zip(_grid(), self._marginal(), strict=True):
            total += likely
            if total >= 0.5:
                return exp(place)
        return _MOST_UA

    @property
    def spread(self) -> float:
        """The standard deviation of the logarithm."""
        marginal = self._marginal()
        mean = sum(place * likely for place, likely in zip(_grid(), marginal, strict=True))
        return sqrt(
            sum((at - mean) ** 2 * likely for at, likely in zip(_grid(), marginal, strict=True))
        )

    def above(self, current_ua: float) -> float:
        """How likely the threshold is above this current."""
        place = log(current_ua)
        return sum(one for at, one in zip(_grid(), self._marginal(), strict=True) if at > place)

    def _marginal(self) -> list[float]:
        return [sum(each) for each in zip(*self._likely, strict=True)]

    def _normalize(self) -> None:
        total = sum(map(sum, self._likely))
        self._likely = [[one / total for one in each] for each in self._likely]


@cache
def _grid() -> tuple[float, ...]:
    count = int(log(_MOST_UA / _LEAST_UA) / _STEP) + 1
    return tuple(log(_LEAST_UA) + _STEP * place for place in range(count))


@cache
def _functions() -> tuple[tuple[float, float, float], ...]:
    return tuple(product(_SPREADS, _GUESSES, _LAPSES))


@cache
def _chances(steps: int, is_felt: bool) -> tuple[tuple[float, ...], ...]:
    """By function and threshold: how likely that answer is at this current, to the nearest step."""
    return tuple(
        tuple(
            chance if is_felt else 1.0 - chance
            for chance in (_felt(steps * _STEP - place, *function) for place in _grid())
        )
        for function in _functions()
    )


def _felt(above: float, spread: float, guess: float, lapse: float) -> float:
    turns = max(-40.0, min(40.0, above / spread))
    return guess + (1.0 - guess - lapse) / (1.0 + exp(-turns))


def _moved(likely: list[float]) -> list[float]:
    """After one more presentation: each place gives a little to its neighbors."""
    aside = 0.5 * (_MOVES / _STEP) ** 2
    padded = [likely[0], *likely, likely[-1]]
    return [
        one * (1.0 - 2.0 * aside) + aside * (padded[place] + padded[place + 2])
        for place, one in enumerate(likely)
    ]
