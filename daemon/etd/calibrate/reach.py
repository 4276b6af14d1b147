"""The highest current that may be presented next on one electrode.

Owns: the bound on every presentation, whichever procedure requests it. Must not know: procedures,
persons, daemons.

A presentation exceeds what was tolerated by at most 10 %, and each needs an answer first. What was
too strong lowers the cap permanently.
"""

from __future__ import annotations

from etd.calibrate.answers import Answer

#: The largest step above what was tolerated.
RISE = 1.10
#: The lowest current that is requested: below a source's step, and not felt.
LEAST_UA = 20


class Reach:
    """One electrode's. `start_ua`: the highest first current. `lowered_ua`: the cap after something
    was too strong.
    """

    def __init__(
        self, cap_ua: int, start_ua: int, tolerated_ua: int = 0, lowered_ua: int | None = None
    ) -> None:
        self.cap_ua = cap_ua if lowered_ua is None else min(cap_ua, lowered_ua)
        self.tolerated_ua = min(tolerated_ua, self.cap_ua)
        self._last_ua = self.tolerated_ua
        #: Something was too strong, and the cap lies below it.
        self.is_cap_felt = lowered_ua is not None
        self._start_ua = max(LEAST_UA, min(start_ua, self.cap_ua))

    @property
    def most_ua(self) -> int:
        """The most that may be presented next."""
        if self.tolerated_ua == 0:
            return min(self._start_ua, self.cap_ua)
        step_ua = max(1, int(self.tolerated_ua * (RISE - 1.0)))
        return min(self.cap_ua, self.tolerated_ua + step_ua)

    def bounded(self, requested_ua: float) -> int:
        return min(max(LEAST_UA, round(requested_ua)), self.most_ua)

    def update(self, current_ua: int, answer: Answer) -> None:
        """Note the person's answer."""
        if answer == "too_strong":
            self.cap_ua = self.left_below(current_ua)
            self.is_cap_felt = True
            self.tolerated_ua = min(self.tolerated_ua, self.cap_ua)
            self._start_ua = min(self._start_ua, self.cap_ua)
        else:
            self.tolerated_ua = max(self.tolerated_ua, current_ua)
            self._last_ua = current_ua

    def left_below(self, current_ua: int) -> int:
        """The cap after `current_ua` was too strong: the highest tolerated current if it is lower;
        otherwise the last tolerated one, since the skin has changed; otherwise a step less.
        """
        for known_ua in (self.tolerated_ua, self._last_ua):
            if 0 < known_ua < current_ua:
                return min(self.cap_ua, known_ua)
        return min(self.cap_ua, a_step_below(current_ua))


def a_step_below(current_ua: int) -> int:
    """The cap after a current was too strong, if nothing weaker was tolerated."""
    return int(current_ua / RISE)
