"""How much stronger or weaker a person wants it, estimated from answers, some of which are wrong.

Owns: the estimate of one offset, as probabilities on a grid, and its forgetting. Must not know:
electrodes, currents, who answers, what is made of the estimate. Time is passed in.

An offset is the natural logarithm of the factor on the current at which the person says *good*.
Beyond `BAND` on either side, with edges that are not sharp, they say *too strong* or *too weak*,
and four answers of five are right. Most likely the strength is what it was when it was calibrated;
else it may be anything: so one answer says little, and several that agree say much. What was said
is forgotten toward the frame's own strength (offset 0), with a time constant of `_FORGOTTEN_NS`.
All figures are by design, tuned on fingers 1, 2, 4, 31 and 41 to 44 of modelled bodies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

#: What a person says of the strength.
Answer = Literal["too_weak", "good", "too_strong"]

_STEP: Final = 0.05
_GRID: Final = tuple(number * _STEP for number in range(-26, 27))
#: Before anything was said: how likely the strength is as it was calibrated, and how far it is off
#: then, and otherwise. It is off to either side alike: *good* by itself then says nothing more.
_AS_CALIBRATED: Final = 0.7
_SIGMA_CALIBRATED: Final = 0.05
_SIGMA_OTHERWISE: Final = 0.35
#: What is within this of the wanted strength is called good (20 % of what is felt); the width of
#: the edge, which answers of the same person do not keep.
BAND: Final = 0.15
_EDGE: Final = 0.05
_RIGHT: Final = 0.8
_WRONG: Final = (1.0 - _RIGHT) / 2.0
_FORGOTTEN_NS: Final = 600_000_000_000
_GROWN: Final = tuple([math.exp(wanted / _EDGE) for wanted in _GRID])


def _bell(sigma: float) -> tuple[float, ...]:
    weights = [math.exp(-0.5 * (offset / sigma) ** 2) for offset in _GRID]
    total = sum(weights)
    return tuple([weight / total for weight in weights])


_PRIOR: Final = tuple(
    [
        _AS_CALIBRATED * near + (1.0 - _AS_CALIBRATED) * far
        for near, far in zip(_bell(_SIGMA_CALIBRATED), _bell(_SIGMA_OTHERWISE), strict=True)
    ]
)


class OffsetEstimate:
    """One offset: of an electrode, or of all of them in common."""

    def __init__(self) -> None:
        self._weights = _PRIOR
        self._mean = 0.0
        self._said_ns = 0

    def mean(self, now_ns: int) -> float:
        """What is expected now; 0 where nothing was said, or all of it is forgotten."""
        return self._kept(now_ns) * self._mean

    def hear(self, answer: Answer, offset: float, now_ns: int) -> None:
        """Takes an answer that was given about the strength at this offset."""
        self.hear_each([self], answer, [offset], now_ns)

    @staticmethod
    def hear_each(
        estimates: Sequence[OffsetEstimate], answer: Answer, offsets: Sequence[float], now_ns: int
    ) -> None:
        """Each of them. An engine hears a word about 256 electrodes between two pulses: those that
        are alike are reckoned once.
        """
        # With the weights of before, so that their identity stays theirs.
        found: dict[tuple[int, float, float], tuple[object, tuple[float, ...], float]] = {}
        for each, offset in zip(estimates, offsets, strict=True):
            before, kept = each._weights, each._kept(now_ns)
            alike = id(before), kept, offset
            if alike not in found:
                found[alike] = before, *_after(before, kept, answer, offset)
            _, each._weights, each._mean = found[alike]
            each._said_ns = now_ns

    def _kept(self, now_ns: int) -> float:
        """How much of what was said still counts."""
        return math.exp(-max(0, now_ns - self._said_ns) / _FORGOTTEN_NS)


def likelihood(answer: Answer, above: float) -> float:
    """How likely it is said at so much above the wanted strength."""
    return _WRONG + (_RIGHT - _WRONG) * _rightly(answer, above)


def _rightly(answer: Answer, above: float) -> float:
    """How likely it is the right answer."""
    strong, weak = _beyond(above - BAND), _beyond(-above - BAND)
    if answer == "too_strong":
        return strong
    return weak if answer == "too_weak" else 1.0 - strong - weak


def _beyond(by: float) -> float:
    # A logistic edge; by `tanh`, which does not overflow however far it is.
    return 0.5 + 0.5 * math.tanh(0.5 * by / _EDGE)


def _after(
    weights: Sequence[float], kept: float, answer: Answer, offset: float
) -> tuple[tuple[float, ...], float]:
    """The weights after an answer, and their mean."""
    known = [
        (kept * weight + (1.0 - kept) * prior) * right
        for weight, prior, right in zip(weights, _PRIOR, _likelihoods(answer, offset), strict=True)
    ]
    total = sum(known)
    after = tuple([weight / total for weight in known])
    return after, sum([weight * wanted for weight, wanted in zip(after, _GRID, strict=True)])


def _likelihoods(answer: Answer, offset: float) -> list[float]:
    """`likelihood` for the whole grid, whose edges are one exponential, times those of the grid."""
    right = _RIGHT - _WRONG
    strong = _exponential((BAND - offset) / _EDGE)
    weak = _exponential((BAND + offset) / _EDGE)
    if answer == "too_strong":
        return [_WRONG + right / (1.0 + strong * grown) for grown in _GROWN]
    if answer == "too_weak":
        return [_WRONG + right / (1.0 + weak / grown) for grown in _GROWN]
    return [
        _WRONG + right * (1.0 - 1.0 / (1.0 + strong * grown) - 1.0 / (1.0 + weak / grown))
        for grown in _GROWN
    ]


def _exponential(power: float) -> float:
    # Far beyond the grid there is no difference, and no number either.
    return math.exp(min(max(power, -600.0), 600.0))
