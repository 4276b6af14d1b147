"""How much stronger or weaker a person wants it, estimated from answers, some of which are wrong.

Owns: the estimate of one offset, as probabilities on a grid, and its forgetting. Must not know:
electrodes, currents, who answers, what is made of the estimate. Time is passed in.

An offset is the natural logarithm of the factor on the current at which the person says *good*.
Beyond `_BAND` on either side they say *too strong* or *too weak*, and four answers of five are
right. What was said is forgotten toward the frame's own strength (offset 0), with a time constant
of `_FORGOTTEN_NS`. All figures are by design, tuned on fingers 1, 2, 4 and 31 of modelled bodies.
"""

from __future__ import annotations

import math
from typing import Final, Literal

#: What a person says of the strength.
Answer = Literal["too_weak", "good", "too_strong"]

_STEP: Final = 0.05
_GRID: Final = tuple(number * _STEP for number in range(-26, 27))
#: Before anything was said: how far the calibration may be off, where less is wanted and where more
#: is. Use raises thresholds by more than anything is known to lower them (Kaczmarek 2000 [abs]).
_SIGMA_LESS: Final = 0.05
_SIGMA_MORE: Final = 0.15
#: What is within this of the wanted strength is called good.
_BAND: Final = 0.3
_RIGHT: Final = 0.8
_WRONG: Final = (1.0 - _RIGHT) / 2.0
_FORGOTTEN_NS: Final = 600_000_000_000


def _prior() -> tuple[float, ...]:
    sigmas = [_SIGMA_LESS if offset < 0.0 else _SIGMA_MORE for offset in _GRID]
    weights = [
        math.exp(-0.5 * (offset / sigma) ** 2) for offset, sigma in zip(_GRID, sigmas, strict=True)
    ]
    total = sum(weights)
    return tuple([weight / total for weight in weights])


_PRIOR: Final = _prior()
_PRIOR_MEAN: Final = sum(weight * offset for weight, offset in zip(_PRIOR, _GRID, strict=True))


class OffsetEstimate:
    """One offset: of an electrode, or of all of them in common."""

    def __init__(self) -> None:
        self._weights = _PRIOR
        self._mean = _PRIOR_MEAN
        self._said_ns = 0

    def mean(self, now_ns: int) -> float:
        """What is expected now; 0 where nothing was said, or all of it is forgotten."""
        kept = self._kept(now_ns)
        return kept * (self._mean - _PRIOR_MEAN)

    def hear(self, answer: Answer, offset: float, now_ns: int) -> None:
        """Takes an answer that was given about the strength at this offset."""
        kept = self._kept(now_ns)
        weights = [
            (kept * weight + (1.0 - kept) * prior) * _likelihood(answer, offset - wanted)
            for weight, prior, wanted in zip(self._weights, _PRIOR, _GRID, strict=True)
        ]
        total = sum(weights)
        self._weights = tuple([weight / total for weight in weights])
        self._mean = sum(
            weight * wanted for weight, wanted in zip(self._weights, _GRID, strict=True)
        )
        self._said_ns = now_ns

    def _kept(self, now_ns: int) -> float:
        """How much of what was said still counts."""
        return math.exp(-max(0, now_ns - self._said_ns) / _FORGOTTEN_NS)


def _likelihood(answer: Answer, above: float) -> float:
    """How likely it is said at so much above the wanted strength."""
    right: Answer = "good"
    if above > _BAND:
        right = "too_strong"
    elif above < -_BAND:
        right = "too_weak"
    return _RIGHT if answer == right else _WRONG
