"""Which connection gives way to a newcomer: none with unread bytes, and no handshake to a process
that has more places.

Owns: the rule by itself, on real connections whose users and processes the tests say.
"""

from __future__ import annotations

import socket
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd.gateway.connection import Connection
from etd.gateway.places import MOST_CONNECTIONS, MOST_GUESTS, Verdict, let_in
from etd.gateway.turns import Sender
from raw_client import hello, part

HOLDER, VICTIM, NEWCOMER = Sender(1_001, 5), Sender(1_001, 6), Sender(1_002, 7)
READY = hello("DEALER")
#: What a client has sent: nothing, half of its handshake, all of it, a stop after that.
SENT = {"silent": b"", "shaking": READY[:12], "ready": READY, "stops": READY}


class Seats:
    """Connections, the oldest first; the other ends are held until it is left."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self.made: list[Connection] = []

    def connect(self, sender: Sender, sent: str = "ready") -> Connection:
        ours, theirs = socket.socketpair()
        self._stack.enter_context(theirs)
        made = Connection(ours, b"ROUTER", 65_536, len(self.made))
        self._stack.callback(made.close)
        made.sender, made.uid = sender, sender.uid
        theirs.send(SENT[sent])
        while made.take() is not None:
            pass
        if sent == "stops":
            theirs.send(part(b'{"op":"stop"}'))
        return made

    def seat(self, sender: Sender, sent: str = "ready", times: int = 1) -> None:
        self.made += [self.connect(sender, sent) for _ in range(times)]

    def verdict(self, sender: Sender) -> Verdict:
        return let_in(self.connect(sender, "silent"), self.made, MOST_GUESTS)


@pytest.fixture
def seats() -> Iterator[Seats]:
    with ExitStack() as stack:
        yield Seats(stack)


def test_the_youngest_of_the_process_that_has_most_gives_way(seats: Seats) -> None:
    seats.seat(HOLDER, times=MOST_CONNECTIONS - 1)
    seats.seat(VICTIM)
    assert seats.verdict(NEWCOMER) == Verdict(True, seats.made[-2])


def test_no_stop_that_is_unread_is_lost_to_a_newcomer_of_another_user(seats: Seats) -> None:
    seats.seat(HOLDER, times=MOST_CONNECTIONS - 1)
    seats.seat(VICTIM, "stops")
    assert seats.verdict(NEWCOMER) == Verdict(True, seats.made[-2])


def test_where_all_that_could_give_way_are_unread_the_newcomer_is_a_guest(seats: Seats) -> None:
    seats.seat(HOLDER, "stops", times=MOST_CONNECTIONS)
    assert seats.verdict(NEWCOMER) == Verdict(True, is_guest=True)


def test_who_connects_again_and_again_ends_no_handshake_of_a_smaller_process(
    seats: Seats,
) -> None:
    churns = Sender(1_002, 8)
    seats.seat(HOLDER, times=MOST_CONNECTIONS - 21)
    seats.seat(churns, times=20)
    seats.seat(VICTIM, "shaking")
    leaving = seats.verdict(churns).leaving
    assert leaving is not None
    assert leaving.sender == HOLDER


@pytest.mark.parametrize("youngest", ["ready", "stops"])
def test_of_many_processes_with_a_place_each_none_loses_a_handshake_or_a_stop(
    seats: Seats, youngest: str
) -> None:
    """To one that has more places, and that connects again and again."""
    churns, others = Sender(1_002, 8), 35
    seats.seat(churns, times=20)
    seats.seat(Sender(1_003, 9), "stops", times=MOST_CONNECTIONS - 20 - others)
    for pid in range(others - 3):
        seats.seat(Sender(1_001, 100 + pid), "shaking" if pid == 0 else "ready")
    for pid, sent in ((7, "ready"), (8, youngest), (9, "shaking")):
        seats.seat(Sender(1_001, pid), sent)
    leaving = seats.made[-2 if youngest == "ready" else -3]
    assert seats.verdict(churns) == Verdict(True, leaving)


@settings(max_examples=60, deadline=None)
@given(
    groups=st.lists(
        st.tuples(
            st.sampled_from([Sender(uid, pid) for uid in (1, 2, 3) for pid in (uid, 10 * uid)]),
            st.sampled_from(sorted(SENT)),
            st.integers(1, 40),
        ),
        min_size=1,
        max_size=8,
    ),
    newcomer=st.sampled_from([Sender(1, 1), Sender(2, 20), Sender(4, 4)]),
)
def test_what_is_unread_stays_and_a_handshake_is_ended_by_no_heavier_process(
    groups: list[tuple[Sender, str, int]], newcomer: Sender
) -> None:
    with ExitStack() as stack:
        seats = Seats(stack)
        for sender, sent, times in groups:
            seats.seat(sender, sent, times)
        seats.made = seats.made[:MOST_CONNECTIONS]
        seats.seat(HOLDER, times=MOST_CONNECTIONS - len(seats.made))
        leaving = seats.verdict(newcomer).leaving
        if leaving is None:
            return
        assert not leaving.has_sent_more()
        if not leaving.is_ready:
            places = Counter(made.sender for made in seats.made)
            assert places[leaving.sender] >= places[newcomer]
