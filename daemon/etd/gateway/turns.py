"""What waits, each of it some process's: the processes take turns.

Owns: whose turn it is, and the order within a process. Must not know: what waits.

A process may hold many connections, and send much by each. However much that is, only one thing of
each other process is taken between two of any process.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Generic, TypeVar

T = TypeVar("T", bound=Hashable)


class Turns(Generic[T]):
    def __init__(self) -> None:
        #: By process; whose turn is next comes first. A dict is a set that keeps its order.
        self._of_process: dict[int, dict[T, None]] = {}

    def __iter__(self) -> Iterator[T]:
        for waiting in self._of_process.values():
            yield from waiting

    def __bool__(self) -> bool:
        return bool(self._of_process)

    def add(self, pid: int, one: T) -> None:
        """It comes last of its process, or stays where it is if it waits already."""
        self._of_process.setdefault(pid, {})[one] = None

    def discard(self, pid: int, one: T) -> None:
        """It need not be there."""
        waiting = self._of_process.get(pid, {})
        waiting.pop(one, None)
        if not waiting:
            self._of_process.pop(pid, None)

    def take(self, may: Callable[[T], bool] = lambda _: True) -> T | None:
        """The next one that may be taken; its process then comes last."""
        for pid, waiting in self._of_process.items():
            one = next(filter(may, waiting), None)
            if one is not None:
                del self._of_process[pid], waiting[one]
                if waiting:
                    self._of_process[pid] = waiting
                return one
        return None
