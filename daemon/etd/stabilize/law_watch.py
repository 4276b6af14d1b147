"""Whether what laws gave and took goes against what the person says.

Owns: which answers count, and how many are too many. Must not know: laws, electrodes, what becomes
of a law that is given up.

An answer counts where laws gave more than 1.1 times the frame's charge, or less than 0.9 times. It
is against them where it says *too strong* of more, or *too weak* of less. What is said within half
a minute of an answer that counts is the same word again: the last of it counts, and once. Five of
the last six against are too many: where laws help, and a person errs once in five times and then in
either direction, six such answers in a row of any are that with a probability of 0.0001; where laws
do harm that is felt, with one of 0.66 (both by the binomial distribution; the bounds by design).
"""

from __future__ import annotations

from collections import deque
from typing import Final

from etd.stabilize.offset_estimate import Answer

MORE: Final = 1.1
LESS: Final = 0.9
LAST: Final = 6
TOO_MANY: Final = 5
SAME_WORD_NS: Final = 30_000_000_000


class LawWatch:
    def __init__(self) -> None:
        self._against: deque[bool] = deque(maxlen=LAST)
        self._counted_ns: int | None = None

    def reset(self) -> None:
        self._against.clear()
        self._counted_ns = None

    def hear(self, answer: Answer, gave: float, now_ns: int) -> None:
        """`gave`: by the laws, in times of the frame's charge, of what the answer is about."""
        if gave > MORE:
            self._count(answer == "too_strong", now_ns)
        elif gave < LESS:
            self._count(answer == "too_weak", now_ns)

    def _count(self, is_against: bool, now_ns: int) -> None:
        if self._counted_ns is not None and now_ns - self._counted_ns < SAME_WORD_NS:
            self._against[-1] = is_against
            return
        self._against.append(is_against)
        self._counted_ns = now_ns

    @property
    def against(self) -> int:
        """Of the last answers that count."""
        return sum(self._against)

    @property
    def is_refuted(self) -> bool:
        return self.against >= TOO_MANY
