"""What waits, each of it some sender's: users take turns, and within a user its processes.

Owns: whose turn it is, and the order within a process. Must not know: what waits.

A user may run many processes, and a process may hold many connections and send much by each.
However much that is, only one thing of each other user is taken between two of any user, and of a
user only one of each other process between two of any process. Where a process has ended that
connected for another one, its number still counts: so a program can be many processes, and no more
than one user.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T", bound=Hashable)


class Sender(NamedTuple):
    """Who connected, by the kernel."""

    uid: int
    pid: int


class Turns(Generic[T]):
    def __init__(self) -> None:
        #: By user and process; whose turn is next comes first. A dict is a set with an order.
        self._of_user: dict[int, dict[int, dict[T, None]]] = {}

    def __iter__(self) -> Iterator[T]:
        for processes in self._of_user.values():
            for waiting in processes.values():
                yield from waiting

    def __bool__(self) -> bool:
        return bool(self._of_user)

    def add(self, sender: Sender, one: T) -> None:
        """It comes last of its process, or stays where it is if it waits already."""
        processes = self._of_user.setdefault(sender.uid, {})
        processes.setdefault(sender.pid, {})[one] = None

    def discard(self, sender: Sender, one: T) -> None:
        """It need not be there."""
        processes = self._of_user.get(sender.uid, {})
        waiting = processes.get(sender.pid, {})
        waiting.pop(one, None)
        if not waiting:
            processes.pop(sender.pid, None)
        if not processes:
            self._of_user.pop(sender.uid, None)

    def take(self, may: Callable[[T], bool] = lambda _: True) -> T | None:
        """The next one that may be taken; its process then comes last of its user's, and its user
        last of all.
        """
        for uid, processes in self._of_user.items():
            for pid, waiting in processes.items():
                one = next(filter(may, waiting), None)
                if one is not None:
                    self.discard(Sender(uid, pid), one)
                    self._comes_last(uid, pid)
                    return one
        return None

    def _comes_last(self, uid: int, pid: int) -> None:
        """If anything of it still waits."""
        if uid in self._of_user:
            processes = self._of_user[uid] = self._of_user.pop(uid)
            if pid in processes:
                processes[pid] = processes.pop(pid)
