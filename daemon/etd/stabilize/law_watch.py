"""Whether what laws gave and took goes against what the person says.

Owns: which answers count, and how many are too many. Must not know: laws, electrodes, what becomes
of a law that is given up.

An answer counts where laws gave more than 1.1 times the frame's charge, or less than 0.9 times. It
is against them where it says *too strong* of more, or *too weak* of less. What is said within half
a minute of an answer that counts is the same word again: the last of it counts, and once.

The answers are tested one after the other (a cumulated sum of the logarithm of how much likelier
each is if laws do harm: Page, "Continuous inspection schemes", Biometrika 41, 1954). Where laws
help, a person who errs once in five times, and then in either direction, says the opposite in one
of ten answers; where what laws do is as often wrong as right, in half of them. The sum begins anew
where it would fall below nothing: what was good for an hour excuses no law that has turned bad.
`REFUTED` is reached by four of the last four, five or six answers, five of up to ten, six of up to
thirteen. Where laws help, that comes with a probability of 0.05 in sixty answers; where half of all
answers are against them, with 0.68 within ten and 0.95 within twenty (the bounds by design).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from etd.stabilize.offset_estimate import Answer

MORE: Final = 1.1
LESS: Final = 0.9
#: How many of the answers are against laws that help, and against laws that do harm.
IF_THEY_HELP: Final = 0.1
IF_THEY_HARM: Final = 0.5
REFUTED: Final = 5.0
SAME_WORD_NS: Final = 30_000_000_000
_AGAINST: Final = math.log(IF_THEY_HARM / IF_THEY_HELP)
_NOT_AGAINST: Final = math.log((1.0 - IF_THEY_HARM) / (1.0 - IF_THEY_HELP))


@dataclass(frozen=True)
class _Sum:
    """Since it was nothing: so many answers, of which so many were against."""

    value: float = 0.0
    answers: int = 0
    against: int = 0

    def with_one(self, *, is_against: bool) -> _Sum:
        value = self.value + (_AGAINST if is_against else _NOT_AGAINST)
        return _Sum(value, self.answers + 1, self.against + is_against) if value > 0.0 else _Sum()


class LawWatch:
    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._before = self._sum = _Sum()
        self._counted_ns: int | None = None

    def hear(self, answer: Answer, gave: float, now_ns: int) -> None:
        """`gave`: by the laws, in times of the frame's charge, of what the answer is about."""
        if gave > MORE:
            self._count(answer == "too_strong", now_ns)
        elif gave < LESS:
            self._count(answer == "too_weak", now_ns)

    def _count(self, is_against: bool, now_ns: int) -> None:
        if self._counted_ns is None or now_ns - self._counted_ns >= SAME_WORD_NS:
            self._before, self._counted_ns = self._sum, now_ns
        self._sum = self._before.with_one(is_against=is_against)

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
