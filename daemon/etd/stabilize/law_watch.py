"""Whether what laws gave and took goes against what the person says.

Owns: how much each answer speaks against laws, and how much is too much. Must not know: laws,
electrodes, what becomes of a law that is given up.

Two things may be so. Laws make up for what the skin does: then the person feels what was wanted,
whatever they gave or took. Or they follow what the skin does not do: then all that they gave is
felt beside it. How likely an answer is either way is what `offset_estimate.py` says of a strength
that is right, and of one that is off by as much as laws gave; so *too strong* of much more speaks
against them, and *good* of much more for them. Nearly the frame's own (`HARDLY`) says nothing of
laws, and does not count. What is said within half a minute of an answer that counts is the same
word again: the last of it counts, and once.

The answers are tested one after the other, by the sum of the logarithms of how much likelier each
is if laws do harm (Page, "Continuous inspection schemes", Biometrika 41, 1954). The sum begins anew
where it would fall below nothing: what was good for an hour excuses no law that has turned bad.
`REFUTED` is by design. Where laws help, and one answer of five errs, in either direction, it is
reached within sixty answers with a probability of 0.01 at most; where all is wrong that laws give,
and they give a quarter more or less in the mean, within ten with 0.7 and within twenty with 0.97.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from etd.stabilize.offset_estimate import Answer, likelihood

REFUTED: Final = 5.5
#: Of the logarithm of what laws gave.
HARDLY: Final = 0.05
SAME_WORD_NS: Final = 30_000_000_000


@dataclass(frozen=True)
class _Sum:
    """Since it was nothing: so many answers, of which so many spoke against laws."""

    value: float = 0.0
    answers: int = 0
    against: int = 0

    def with_one(self, by: float) -> _Sum:
        value = self.value + by
        return _Sum(value, self.answers + 1, self.against + (by > 0.0)) if value > 0.0 else _Sum()


class LawWatch:
    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._before = self._sum = _Sum()
        self._counted_ns: int | None = None

    def hear(self, answer: Answer, gave: float, now_ns: int) -> None:
        """`gave`: by the laws, in times of the frame's charge, of what the answer is about."""
        above = math.log(gave)
        if abs(above) < HARDLY:
            return
        if self._counted_ns is None or now_ns - self._counted_ns >= SAME_WORD_NS:
            self._before, self._counted_ns = self._sum, now_ns
        by = math.log(likelihood(answer, above) / likelihood(answer, 0.0))
        self._sum = self._before.with_one(by)

    @property
    def answers(self) -> int:
        """How many it goes by: those before spoke for the laws at least as much as against."""
        return self._sum.answers

    @property
    def against(self) -> int:
        """Of these."""
        return self._sum.against

    @property
    def is_refuted(self) -> bool:
        return self._sum.value >= REFUTED
