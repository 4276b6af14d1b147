"""A Unix socket that clients connect to, and all that are connected.

Owns: in which turn they are read, and the counts of those that ended or were not let in.
Must not know: who is let in, what a message means.

The kernel has one line of newcomers for all users. While it is full nobody else gets into it, and
libzmq tries again 100 ms later. So more of them are taken out of it in a look than are let in, and
those that only fill it cost little: who has left without a byte, and of a process that sends many,
who has said nothing yet.
"""

from __future__ import annotations

import itertools
import os
import select
import socket
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from etd.gateway import places
from etd.gateway.connection import Connection, sender_of
from etd.gateway.turns import Sender, Turns
from etd.protocol.zmtp import Parts, message

#: Taken out of the line in one look.
_ACCEPTS_A_LOOK = 64
#: Let in of these: few, so that a newcomer has some looks to say something.
_LET_IN_A_LOOK = 16
#: And of one process, of those that have said nothing yet.
_SILENT_OF_A_PROCESS = 8
#: The line's length. In a longer one who has got into it waits longer than saves trying again.
_BACKLOG = 128


class Listener:
    """Listens when made. Registered in `epoll` are its own descriptor and each connection's."""

    def __init__(
        self,
        path: Path,
        kind: bytes,
        most_bytes: int,
        epoll: select.epoll,
        most_guests: int = 0,
    ) -> None:
        """`most_guests`: so many are let in without a place; who reads them heeds `is_guest`."""
        self._path = path
        self._kind = kind
        self._most_bytes = most_bytes
        self._epoll = epoll
        self._most_guests = most_guests
        #: By descriptor; a dict, so the oldest come first.
        self._connections: dict[int, Connection] = {}
        self._by_number: dict[int, Connection] = {}
        #: Those with something to read; who was read comes last.
        self._readable: Turns[Connection] = Turns()
        self._counts: Counter[str] = Counter()
        self._name = path.stem
        self._numbers = itertools.count(1)
        #: Given up where no other is left, so that a newcomer can be heard or closed at all.
        self._spare: int | None = None
        path.unlink(missing_ok=True)  # of a gateway that was killed: the lock is held by this one
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.setblocking(False)
            with _group_only():
                self._socket.bind(str(path))
            self._socket.listen(_BACKLOG)
            epoll.register(self._socket, select.EPOLLIN)
            self._spare = _idle_descriptor()
        except BaseException:
            self._socket.close()
            raise

    def close(self) -> None:
        """Idempotent; takes the file away."""
        if self._socket.fileno() >= 0:
            for connection in self._connections.values():
                connection.close()
            self._socket.close()
            self._give_up_spare()
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

    def is_heard_by(self, number: int) -> bool:
        """False: that client has left, as far as is known."""
        connection = self._by_number.get(number)
        return connection is not None and connection.hears

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

    def turn_away(self, victim: Connection) -> None:
        """It had to give way, or was let in for something else than it asks for."""
        if victim.is_open:
            self._counts[f"{self._name}_turned_away"] += 1
            fileno = victim.fileno()
            victim.close()
            self._forget(fileno, victim)

    def _watch(self, fileno: int, connection: Connection) -> None:
        """After anything that may have closed it, or left something unread."""
        if connection.is_open:
            wanted = select.EPOLLIN | (select.EPOLLOUT if connection.has_unread else 0)
            if connection.watched != wanted:
                connection.watched = wanted
                self._epoll.modify(fileno, wanted)
        elif self._forget(fileno, connection):
            places.seat_a_guest(list(self._connections.values()))

    def _accept(self) -> None:
        let_in, silent = 0, Counter[Sender]()
        for _ in range(_ACCEPTS_A_LOOK):
            try:
                accepted, _ = self._socket.accept()
            except BlockingIOError:
                return
            except OSError:
                self._accept_last()
                return
            no_use = _no_use(accepted, silent)
            if no_use is not None:
                accepted.close()
                self._counts[f"{self._name}_{no_use}"] += 1
                continue
            self._judge(accepted)
            let_in += 1
            if let_in >= _LET_IN_A_LOOK:
                return

    def _accept_last(self) -> None:
        """With the spare descriptor: a silent connection leaves for the newcomer, or it does."""
        self._give_up_spare()
        accepted: socket.socket | None = None
        # Another process may have taken the system's last, or the newcomer may have left.
        with suppress(OSError):
            accepted, _ = self._socket.accept()
        if accepted is not None:
            self._judge(accepted, is_last=True)
        # Where none is left even now, the next newcomer waits in the kernel until there is.
        with suppress(OSError):
            self._spare = _idle_descriptor()

    def _give_up_spare(self) -> None:
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None

    def _judge(self, accepted: socket.socket, is_last: bool = False) -> None:
        made = Connection(accepted, self._kind, self._most_bytes, next(self._numbers))
        held = list(self._connections.values())
        verdict = places.let_in(made, held, self._most_guests, is_last)
        if verdict.leaving is not None:
            self.turn_away(verdict.leaving)
        if verdict.is_let_in:
            made.is_guest = verdict.is_guest
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

    def _forget(self, fileno: int, ended: Connection) -> bool:
        """Whether it was one of these."""
        if self._connections.pop(fileno, None) is None:
            return False
        del self._by_number[ended.number]
        self._readable.discard(ended.sender, ended)
        self._counts[f"{self._name}_disconnects"] += 1
        if ended.is_broken_off:
            self._counts[f"{self._name}_broken_off"] += 1
        return True


def _no_use(accepted: socket.socket, silent: Counter[Sender]) -> str | None:
    """As what it is counted, if it is to be closed at once. `silent`: so many in this look."""
    try:
        has_left = not accepted.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
    except BlockingIOError:
        sender = sender_of(accepted)
        silent[sender] += 1
        return "turned_away" if silent[sender] > _SILENT_OF_A_PROCESS else None
    except OSError:
        has_left = True
    return "disconnects" if has_left else None


@contextmanager
def _group_only() -> Iterator[None]:
    """Socket files get mode 0660 from the start: a user who can write to one can connect."""
    before = os.umask(0o117)
    try:
        yield
    finally:
        os.umask(before)


def _idle_descriptor() -> int:
    return os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
