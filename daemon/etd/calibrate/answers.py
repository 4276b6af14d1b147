"""The questions to the person, and the possible answers.

Owns: both vocabularies, and the Protocol of what answers: a person at a terminal, a study program's
own window, a simulated person. Must not know: currents, procedures, terminals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

#: `strength`: is it felt, and how strongly? `sure`: after `too_strong` to that: again, or what it
#: was instead, since keys slip. `compare`: is the second as strong as the first? `which`: after
#: `too_strong` to that: which of the two? `whole`: all electrodes at once, at level 1. `in_use`:
#: all at once for minutes, is it as strong as at first? `sure_in_use`: after `too_strong` to that.
#: `quality` and `place`: what does it feel like, and where, at the comfortable level? `stopped`,
#: `stopped_which`, `stopped_whole`: of what was presented last, of two, of all at once, when it was
#: stopped before something else was presented.
Ask = Literal[
    "strength",
    "sure",
    "compare",
    "which",
    "whole",
    "in_use",
    "sure_in_use",
    "quality",
    "place",
    "stopped",
    "stopped_which",
    "stopped_whole",
]
Answer = Literal[
    "not_felt",
    "felt",
    "comfortable",
    "too_strong",
    "weaker",
    "same",
    "stronger",
    "first",
    "second",
    "both",
    "neither",
    "vibration",
    "pressure",
    "prickling",
    "other",
    "under",
    "around",
    "elsewhere",
    "stop",
    "pause",
]

ANSWERS: dict[Ask, tuple[Answer, ...]] = {
    "strength": ("not_felt", "felt", "comfortable", "too_strong"),
    "sure": ("not_felt", "felt", "comfortable", "too_strong"),
    "compare": ("weaker", "same", "stronger", "too_strong"),
    "which": ("first", "second", "both", "neither"),
    "whole": ("not_felt", "felt", "comfortable", "too_strong"),
    "in_use": ("weaker", "same", "stronger", "too_strong"),
    "sure_in_use": ("weaker", "same", "stronger", "too_strong"),
    "quality": ("vibration", "pressure", "prickling", "other", "too_strong"),
    "place": ("under", "around", "elsewhere"),
    "stopped": ("not_felt", "felt", "comfortable", "too_strong"),
    "stopped_which": ("first", "second", "both", "neither"),
    "stopped_whole": ("not_felt", "felt", "comfortable", "too_strong"),
}


_TURNED: dict[Answer, Answer] = {
    "weaker": "stronger",
    "stronger": "weaker",
    "first": "second",
    "second": "first",
}


@dataclass(frozen=True, slots=True)
class Question:
    """About the last presentation. Without the current: it could influence the answer."""

    ask: Ask
    electrode: int
    #: With `compare` and `which`: what it is compared with, presented before it or after it. The
    #: answers are about the second, or name the first and the second.
    reference: int | None = None
    is_reference_last: bool = False
    #: Once more, since the answer before said that something was not too strong, and keys slip.
    is_again: bool = False


@dataclass(frozen=True, slots=True)
class Presentation:
    """What a question is about: for the screen, and for the table of trials. Times are of
    the stimulator's clock. Of the whole array the electrode with the highest current stands here.
    """

    electrode: int
    #: As requested, and as it was commanded to the source.
    current_ua: int
    commanded_ua: int
    begun_ns: int
    resistance_ohm: int | None = None
    #: With `compare` and `which`: what it was compared with, and whether that came after it.
    reference: int | None = None
    reference_ua: int | None = None
    is_reference_last: bool = False
    #: Of a catch trial, which is silent: the current that comes to this electrode next. It is
    #: shown in place of the 0, which would tell.
    stands_for_ua: int | None = None
    #: All electrodes at once.
    is_whole: bool = False
    #: At which it was presented; None: that of the conditions.
    rate_hz: float | None = None

    @property
    def is_catch(self) -> bool:
        return self.stands_for_ua is not None


def turned(answer: Answer) -> Answer:
    """What an answer about the reference says of the electrode, and the other way round."""
    return _TURNED.get(answer, answer)


class Answerer(Protocol):
    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        """One of ANSWERS, `stop` (stop at once) or `pause` (continue another time). While waiting
        for the answer, call `keep` at least three times a second: it renews the lease, and raises
        when the daemon has halted.
        """
        ...

    def wants_stop(self) -> bool:
        """Polled during presentations and pauses."""
        ...
