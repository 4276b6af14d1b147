"""A procedure as a generator, and running it within its reach: alone, or in turn with others.

Owns: the interface of procedures (it yields the current it requests next, and is sent the current
presented and the answer), and that no request exceeds the reach. Must not know: which procedures
there are, how a current is presented.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

from etd.calibrate.answers import Answer
from etd.calibrate.reach import Reach
from etd.protocol.errors import EtdError


@dataclass(frozen=True, slots=True)
class Heard:
    """The presentation and its answer; whether no higher current is allowed, and whether that is
    because a higher one was too strong (so it was felt, if not at this current).
    """

    current_ua: int
    answer: Answer
    is_at_cap: bool = False
    is_cap_felt: bool = False

    @property
    def is_felt(self) -> bool:
        return self.answer != "not_felt"


#: More than these for one electrode mean random answers, or a tired person.
MOST_PRESENTATIONS = 150

R = TypeVar("R")
Procedure: TypeAlias = Generator[float, Heard, R]


class Stopped(EtdError):
    """The person or the operator ended it. Fields: answer (`stop` or `pause`), why (empty: by a
    key).
    """

    def __init__(self, answer: Answer, why: str = "") -> None:
        self.answer: Answer = answer
        self.why = why
        by = f" ({why})" if why else ""
        super().__init__(f"stopped{by}: the daemon is halted" if answer == "stop" else "paused")


class TooStrongSaid(Stopped):
    """*Too strong* of what is presented, by a word that answers no question: a stop."""

    def __init__(self) -> None:
        super().__init__("stop", "too strong, by a button, a monitor or another program")


class Unsettled(EtdError):
    """The answers gave no result. Fields: presentations."""

    def __init__(self, presentations: int) -> None:
        self.presentations = presentations
        super().__init__(f"no result after {presentations} presentations: try again after a rest")


class BelowThreshold(EtdError):
    """Something was too strong, and the cap is now below the threshold. Fields: electrode."""

    def __init__(self, electrode: int) -> None:
        self.electrode = electrode
        super().__init__(
            "something was too strong, and the electrode's cap is now below its threshold in the"
            " baseline: calibrate it again with another --method"
        )


class Track(Generic[R]):
    """One procedure under way, within its reach. There is a `result` when it `is_over`."""

    def __init__(self, procedure: Procedure[R], reach: Reach) -> None:
        self._procedure = procedure
        self._reach = reach
        self._presentations = 0
        self._requested_ua = 0.0
        self.is_over = False
        self._advance(lambda: next(procedure))

    @property
    def current_ua(self) -> int:
        """What is presented next."""
        return self._reach.bounded(self._requested_ua)

    @property
    def result(self) -> R:
        return self._result

    def hear(self, current_ua: int, answer: Answer) -> None:
        """The answer to this presentation. Raises: Stopped, Unsettled."""
        if answer in ("stop", "pause"):
            raise Stopped(answer)
        reach = self._reach
        reach.update(current_ua, answer)
        heard = Heard(current_ua, answer, current_ua >= reach.cap_ua, reach.is_cap_felt)
        self._advance(lambda: self._procedure.send(heard))
        self._presentations += 1
        if not self.is_over and self._presentations >= MOST_PRESENTATIONS:
            raise Unsettled(MOST_PRESENTATIONS)

    def _advance(self, step: Callable[[], float]) -> None:
        try:
            self._requested_ua = step()
        except StopIteration as end:
            self._result: R = end.value
            self.is_over = True


def run(procedure: Procedure[R], reach: Reach, present: Callable[[int], Answer]) -> R:
    """`present` shows a current and returns the answer. Raises: Stopped, Unsettled."""
    track = Track(procedure, reach)
    while not track.is_over:
        current_ua = track.current_ua
        track.hear(current_ua, present(current_ua))
    return track.result
