"""What is asked of the person, and what may be answered.

Owns: the vocabulary, and the Protocol that whoever answers keeps: a person at a terminal, a study
program's own window, a simulated person. Must not know: currents, procedures, terminals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

#: `strength`: is it felt, and how strongly? `compare`: is the second as strong as the first?
#: `which`: after `too_strong` to that: which of the two?
Ask = Literal["strength", "compare", "which"]
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
    "stop",
    "pause",
]

ANSWERS: dict[Ask, tuple[Answer, ...]] = {
    "strength": ("not_felt", "felt", "comfortable", "too_strong"),
    "compare": ("weaker", "same", "stronger", "too_strong"),
    "which": ("first", "second", "both"),
}


@dataclass(frozen=True, slots=True)
class Question:
    """About what was just presented, without the current: a person should not answer by number."""

    ask: Ask
    electrode: int
    #: With `compare` and `which`: what was presented first.
    reference: int | None = None


class Answerer(Protocol):
    """See the module."""

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        """One of ANSWERS, `stop` (silent at once) or `pause` (come back another time). While
        nobody has answered yet, `keep` is to be called three times a second or more often: it
        holds the lease, and raises when the daemon has halted.
        """
        ...

    def wants_stop(self) -> bool:
        """Asked all the while something is presented or paused."""
        ...
