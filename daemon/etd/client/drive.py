"""Drives a generator of steps to its end, blocking: the session's flows, and courses of flows.

Owns: that what a step raises is raised in the generator, at the `yield` of that step. Must not
know: what a step is, how it is done.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Generator
from typing import Any, TypeVar

S = TypeVar("S")
R = TypeVar("R")


def drive(
    steps: Generator[S, Any, R],
    do: Callable[[S], object],
    raised_within: type[BaseException] = BaseException,
) -> R:
    """Do each step and send its result; returns the generator's result. What a step raises, and
    what interrupts between two steps, is raised in the generator, if it is a `raised_within`;
    otherwise it ends the drive without the generator's say.
    """
    done: object = None
    raised: BaseException | None = None
    while True:
        # What was raised is not handled any more: what is raised later is no consequence of it.
        try:
            # In one `try`, so that there is nothing between two steps.
            while True:
                step = steps.send(done) if raised is None else steps.throw(raised)
                done = raised = None
                done = do(step)
        except StopIteration as end:
            if not has_ended(steps):
                raise  # of a step, and no result
            result: R = end.value
            return result
        except raised_within as error:
            if has_ended(steps):
                raise
            raised = error


def has_ended(steps: Generator[Any, Any, Any]) -> bool:
    """Whether what was raised came out of it."""
    return inspect.getgeneratorstate(steps) == inspect.GEN_CLOSED
