"""The questions to the person, and the possible answers.

Owns: both vocabularies, and the Protocol of what answers: a person at a terminal, a study program's
own window, a simulated person. Must not know: currents, procedures, terminals.
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
    """About the last presentation. Without the current: it could influence the answer."""

    ask: Ask
    electrode: int
    #: With `compare` and `which`: what was presented first.
    reference: int | None = None


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
