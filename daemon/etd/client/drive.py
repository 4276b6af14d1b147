"""Drives a generator of steps to its end, blocking: the session's flows, and courses of flows.

Owns: that what a step raises is raised in the generator, at the `yield` of that step. Must not
know: what a step is, how it is done.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, TypeVar

S = TypeVar("S")
R = TypeVar("R")


def drive(
    steps: Generator[S, Any, R],
    do: Callable[[S], object],
    raised_within: type[BaseException] = BaseException,
) -> R:
    """Do each step and send its result; returns the generator's result. Errors of a step that are
    no `raised_within` end the drive without the generator's say.
    """
    try:
        step = next(steps)
        while True:
            raised: BaseException | None = None
            try:
                done = do(step)
            except raised_within as error:
                raised = error
            # Not while it is handled: what is raised later is no consequence of it.
            step = steps.send(done) if raised is None else steps.throw(raised)
    except StopIteration as end:
        result: R = end.value
        return result
