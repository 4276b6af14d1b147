"""Lines of the log that can be caused in a loop: some are told one by one, the others together.

Owns: how many of each user, or of each cause, have lines of their own, and the sentence for the
others. Must not know: what happened, time: the journal says when one summary ends and the next
begins.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Final

#: Between two summaries, so many lines of one user, or of one cause, are told one by one.
MOST_ONE_BY_ONE: Final = 20
#: So many users, or causes, have that many each; those beyond have it together.
MOST_APART: Final = 8
_TOGETHER: Final = "others"


@dataclass(slots=True)
class _Share:
    told: int = 0
    untold: int = 0
    errors: int = 0
    last: tuple[int, str] = logging.INFO, ""


class SummedUp:
    """Lines of one kind. What one user causes takes no line of another one's."""

    def __init__(self, log: logging.Logger, what: str, errors: str = "") -> None:
        """`what`: the lines, in plural; `errors`: those of them that are errors."""
        self._log = log
        self._what = what
        self._errors = errors
        self._shares: dict[str, _Share] = {}

    def has_room(self, whose: str) -> bool:
        """For one line more."""
        return self._share(whose).told < MOST_ONE_BY_ONE

    def tell(self, whose: str, level: int, text: str, *, always: bool = False) -> bool:
        """Whether it has a line of its own. `whose`: by whom or what it was caused, "" by none.
        `always`: it has one, since something else bounds how many these are.
        """
        share = self._share(whose)
        if always or share.told < MOST_ONE_BY_ONE:
            share.told += 1
            self._log.log(level, "%s", text)
            return True
        share.untold += 1
        share.errors += level == logging.ERROR
        share.last = level, text
        return False

    def sum_up(self) -> None:
        """What had no line of its own."""
        for whose, share in self._shares.items():
            if share.untold:
                level, last = share.last
                by = f" by {whose}" if whose else ""
                errors = f", {share.errors} of them {self._errors}" if share.errors else ""
                more = f"{share.untold} more {self._what}{by}{errors}"
                self._log.log(level, "since the last summary: %s; the last: %s", more, last)
        self._shares.clear()

    def _share(self, whose: str) -> _Share:
        is_known = whose in self._shares or len(self._shares) < MOST_APART
        return self._shares.setdefault(whose if is_known else _TOGETHER, _Share())
