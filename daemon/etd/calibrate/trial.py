"""A procedure as a generator, and the loop that runs it within its reach.

Owns: the interface of procedures (it yields the current it requests next, and is sent the current
presented and the answer), and that no request exceeds the reach. Must not know: which procedures
there are, how a current is presented.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

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
    """The person or the operator ended it. Fields: answer (`stop` or `pause`)."""

    def __init__(self, answer: Answer) -> None:
        self.answer: Answer = answer
        super().__init__("stopped: the daemon is halted" if answer == "stop" else "paused")


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


def run(procedure: Procedure[R], reach: Reach, present: Callable[[int], Answer]) -> R:
    """`present` shows a current and returns the answer. Raises: Stopped, Unsettled."""
    try:
        requested_ua = next(procedure)
        for _ in range(MOST_PRESENTATIONS):
            current_ua = reach.bounded(requested_ua)
            answer = present(current_ua)
            if answer in ("stop", "pause"):
                raise Stopped(answer)
            reach.update(current_ua, answer)
            is_at_cap = current_ua >= reach.cap_ua
            requested_ua = procedure.send(Heard(current_ua, answer, is_at_cap, reach.is_cap_felt))
    except StopIteration as end:
        result: R = end.value
        return result
    raise Unsettled(MOST_PRESENTATIONS)
