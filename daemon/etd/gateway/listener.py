"""A Unix socket that clients connect to, and all that are connected.

Owns: how many may be, who gives way when there is no room, in which turn they are read, and the
counts of those that ended. Must not know: what a message means.
"""

from __future__ import annotations

import itertools
import os
import select
import socket
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from etd.gateway.connection import Connection
from etd.gateway.turns import Turns
from etd.gateway.zmtp import Parts, message

#: On each of three sockets: far below a process's usual limit of 1 024 descriptors.
MOST_CONNECTIONS = 80
#: Accepted in one turn: few, so that a newcomer has some turns to say something.
_ACCEPTS_A_TURN = 16
#: Those that wait to be accepted, in the kernel.
_BACKLOG = 128


class Listener:
    """Listens when made. Registered in `epoll` are its own descriptor and each connection's."""

    def __init__(
        self,
        path: Path,
        kind: bytes,
        most_bytes: int,
        epoll: select.epoll,
    ) -> None:
        self._path = path
        self._kind = kind
        self._most_bytes = most_bytes
        self._epoll = epoll
        #: By descriptor; a dict, so the oldest come first.
        self._connections: dict[int, Connection] = {}
        self._by_number: dict[int, Connection] = {}
        #: Those with something to read; who was read comes last.
        self._readable: Turns[Connection] = Turns()
        self._counts: Counter[str] = Counter()
        self._name = path.stem
        self._numbers = itertools.count(1)
        path.unlink(missing_ok=True)  # of a gateway that was killed: the lock is held by this one
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.setblocking(False)
            with _group_only():
                self._socket.bind(str(path))
            self._socket.listen(_BACKLOG)
            epoll.register(self._socket, select.EPOLLIN)
        except BaseException:
            self._socket.close()
            raise

    def close(self) -> None:
        """Idempotent; takes the file away."""
        if self._socket.fileno() >= 0:
            for connection in self._connections.values():
                connection.close()
            self._socket.close()
            self._path.unlink(missing_ok=True)

    @property
    def has_more(self) -> bool:
        """Something was read that was not taken yet: no time to wait."""
        return bool(self._readable)

    def take_counts(self) -> Counter[str]:
        """What ended, or was not let in, since the last call."""
        counts, self._counts = self._counts, Counter()
        return counts

    def connections(self) -> list[Connection]:
        """Those whose handshake is complete."""
        return [made for made in self._connections.values() if made.is_ready]

    def look(self, fileno: int, events: int) -> None:
        """Something happened to this descriptor; ignored if it is none of these."""
        if fileno == self._socket.fileno():
            self._accept()
            return
        connection = self._connections.get(fileno)
        if connection is None:
            return
        if events & select.EPOLLOUT:
            connection.flush()
            self._watch(fileno, connection)
        if events & ~select.EPOLLOUT:
            self._readable.add(connection.sender, connection)

    def take_each(self, may: Callable[[Connection], bool]) -> Iterator[tuple[Connection, Parts]]:
        """Messages that are there, one of each connection that may; none loses its turn by it."""
        for connection in list(filter(may, self._readable)):
            yield from self._taken(connection)

    def take(self, most: int) -> Iterator[tuple[Connection, Parts]]:
        """Messages that are there, at most so many: one of each user before the next of any, of a
        user one of each process, and of a process one of each connection.
        """
        for _ in range(most):
            connection = self._readable.take()
            if connection is None:
                return
            yield from self._taken(connection)

    def _taken(self, connection: Connection) -> Iterator[tuple[Connection, Parts]]:
        """The next message, if it is whole."""
        fileno = connection.fileno()
        parts = connection.take()
        if parts is None:
            self._readable.discard(connection.sender, connection)
        else:
            self._readable.add(connection.sender, connection)
        self._watch(fileno, connection)
        if parts:
            yield connection, parts

    def reply(self, number: int, parts: tuple[bytes, ...]) -> bool:
        """False: that client has left, or does not read."""
        connection = self._by_number.get(number)
        return connection is not None and self.send(connection, message(parts))

    def send(self, connection: Connection, data: bytes) -> bool:
        fileno = connection.fileno()
        is_taken = connection.send(data)
        self._watch(fileno, connection)
        return is_taken

    def break_off(self, connection: Connection) -> None:
        """A client that broke a bound which is not of its bytes."""
        fileno = connection.fileno()
        connection.break_off()
        self._watch(fileno, connection)

    def _watch(self, fileno: int, connection: Connection) -> None:
        """After anything that may have closed it, or left something unread."""
        if connection.is_open:
            wanted = select.EPOLLIN | (select.EPOLLOUT if connection.has_unread else 0)
            if connection.watched != wanted:
                connection.watched = wanted
                self._epoll.modify(fileno, wanted)
        elif self._connections.pop(fileno, None) is not None:
            del self._by_number[connection.number]
            self._readable.discard(connection.sender, connection)
            self._counts[f"{self._name}_disconnects"] += 1
            if connection.is_broken_off:
                self._counts[f"{self._name}_broken_off"] += 1

    def _accept(self) -> None:
        for _ in range(_ACCEPTS_A_TURN):
            try:
                accepted, _ = self._socket.accept()
            except BlockingIOError:
                return
            except OSError:
                # No descriptor is left: one of these gives way.
                held = list(self._connections.values())
                if held:
                    self._turn_away(_silent_one(held) or held[-1])
                return
            made = Connection(accepted, self._kind, self._most_bytes, next(self._numbers))
            if len(self._connections) < MOST_CONNECTIONS or self._make_room(made):
                self._admit(made)
            else:
                made.close()
                self._counts[f"{self._name}_turned_away"] += 1

    def _admit(self, made: Connection) -> None:
        fileno = made.fileno()
        if not made.is_open:
            return
        self._connections[fileno] = self._by_number[made.number] = made
        made.watched = select.EPOLLIN | (select.EPOLLOUT if made.has_unread else 0)
        self._epoll.register(fileno, made.watched)
        self._readable.add(made.sender, made)

    def _make_room(self, newcomer: Connection) -> bool:
        """The longest silent one gives way, of the process that has most first; none with unread
        bytes, which may be a stop. Or else one of the user, or of the process, that has the most,
        if it has more than the newcomer's. For a newcomer of the process that has most only a
        silent one of its own does: else a process that connects again and again would end others
        during their handshake.
        """
        held = list(self._connections.values())
        of_process = Counter(made.sender.pid for made in held)
        heaviest = max(of_process.values())
        if of_process[newcomer.sender.pid] >= heaviest:
            own = _silent_one([made for made in held if made.sender.pid == newcomer.sender.pid])
            return own is not None and self._turn_away(own)
        silent = _silent_one([made for made in held if of_process[made.sender.pid] == heaviest])
        silent = silent or _silent_one(held)
        if silent is not None:
            return self._turn_away(silent)
        owner: Callable[[Connection], int]
        for owner in (lambda made: made.uid, lambda made: made.sender.pid):
            counts = Counter(map(owner, held))
            ((most_of, most),) = counts.most_common(1)
            if most > counts[owner(newcomer)] + 1:
                newest_first = reversed(held)
                return self._turn_away(next(m for m in newest_first if owner(m) == most_of))
        return False

    def _turn_away(self, victim: Connection) -> bool:
        self._counts[f"{self._name}_turned_away"] += 1
        fileno = victim.fileno()
        victim.close()
        self._watch(fileno, victim)
        return True


def _silent_one(held: list[Connection]) -> Connection | None:
    """The oldest that never sent a byte, or else the oldest that never completed its handshake;
    none with bytes that were not read yet.
    """
    unready = [made for made in held if not made.is_ready]
    unspoken = (made for made in unready if not made.has_spoken)
    return next((made for made in (*unspoken, *unready) if not made.has_sent_more()), None)


@contextmanager
def _group_only() -> Iterator[None]:
    """Socket files get mode 0660 from the start: a user who can write to one can connect."""
    before = os.umask(0o117)
    try:
        yield
    finally:
        os.umask(before)
