"""The most that an electrode gets after *too strong* was said of a pulse that other limits had
lowered already.

Owns: that ceiling, in uA, and how it rises. Must not know: who says what, which limit it was, what
the frame asks for.

`said.py` takes its part of what a frame asks. Where a soft start, a cap or a return has left less
than that, such a part takes nothing of what is felt, and a soft start goes on to rise. So then the
part is taken of what was fired. Nothing passes it before the lease's holder says something else:
*good* gives back what was taken, *too weak* lets it rise beyond, both by 5 % in any minute, and not
within a minute of *too strong*.
"""

from __future__ import annotations

import math
from typing import Final

from etd.stabilize.said_electrode import LETS_RISE_NS, MINUTE_NS, RISE_LOG

#: Less than this is no rise but rounding.
_LEAST_LOG: Final = 1e-9
#: No word takes more than to here, of which nothing is fired: it is still a number to divide by.
_FLOOR_UA: Final = 0.1


class FiredCeiling:
    """`most_ua`: what is left. `too_strong_ua`: what the last word was said of."""

    __slots__ = ("_goal_ua", "_rises", "_until_ns", "most_ua", "too_strong_ua")

    def __init__(self, fired_ua: float, left: float, now_ns: int) -> None:
        self.most_ua = fired_ua
        self._until_ns = now_ns
        self.lower(fired_ua, left, now_ns)

    def lower(self, fired_ua: float, left: float, now_ns: int) -> None:
        """Of what was fired, this part is left; and what an earlier word lets rise does not."""
        self.too_strong_ua = max(fired_ua, _FLOOR_UA)
        self.most_ua = max(min(fired_ua, self.most_ua) * left, _FLOOR_UA)
        self._goal_ua = self.most_ua
        self._rises: tuple[tuple[int, float], ...] = ((now_ns, RISE_LOG),)

    def let_rise(self, now_ns: int, *, is_weak: bool) -> bool:
        """By the next word, once. False: it does not rise by that."""
        by_word_ua = self.most_ua * math.exp(RISE_LOG)
        self._goal_ua = by_word_ua if is_weak else min(by_word_ua, self.too_strong_ua)
        self._until_ns = now_ns + LETS_RISE_NS
        wanted = math.log(self._goal_ua / self.most_ua)
        self.rise(now_ns)
        return wanted > _LEAST_LOG

    def rise(self, now_ns: int) -> None:
        """As far as the last minute leaves room, with a pulse or a word."""
        if now_ns >= self._until_ns:
            return
        self._rises = tuple([rise for rise in self._rises if now_ns - rise[0] < MINUTE_NS])
        room = RISE_LOG - sum([by for _, by in self._rises])
        by = min(math.log(self._goal_ua / self.most_ua), room)
        if by > _LEAST_LOG:
            self.most_ua *= math.exp(by)
            self._rises = (*self._rises, (now_ns, by))
