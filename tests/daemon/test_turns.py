"""Turns: one of each other user between two of any, and of a user one of each other process."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from etd.gateway.turns import Sender, Turns

Waiting = list[tuple[Sender, int]]

waiting = st.lists(
    st.tuples(
        st.builds(Sender, uid=st.integers(0, 3), pid=st.integers(0, 5)), st.integers(0, 1_000)
    ),
    unique=True,
    max_size=80,
)


def taken(those: Waiting) -> Waiting:
    """In the order of their turns; each comes back once, and is taken again."""
    turns: Turns[tuple[Sender, int]] = Turns()
    for one in those:
        turns.add(one[0], one)
    order = []
    while (one_taken := turns.take()) is not None:
        order.append(one_taken)
        if order.count(one_taken) == 1:
            turns.add(one_taken[0], one_taken)
    assert not turns
    return order


@given(waiting)
def test_between_two_of_a_user_there_is_one_of_each_that_waits(those: Waiting) -> None:
    order = taken(those)
    assert sorted(order) == sorted(those * 2)
    uids = [sender.uid for sender, _ in order]
    for place, uid in enumerate(uids):
        if uid in uids[place + 1 :]:
            following = uids[place + 1 : uids.index(uid, place + 1)]
            assert set(uids[place + 1 :]) - {uid} <= set(following)
            assert len(following) == len(set(following))


@given(waiting)
def test_and_of_a_user_between_two_of_a_process_one_of_each(those: Waiting) -> None:
    order = [sender for sender, _ in taken(those) if sender.uid == 1]
    for place, sender in enumerate(order):
        if sender in order[place + 1 :]:
            following = order[place + 1 : order.index(sender, place + 1)]
            assert set(order[place + 1 :]) - {sender} <= set(following)
            assert len(following) == len(set(following))


def test_a_program_of_many_processes_is_one_user() -> None:
    turns: Turns[str] = Turns()
    for pid in range(70):
        turns.add(Sender(1, pid), f"flooding {pid}")
    turns.add(Sender(2, 70), "theirs")
    turns.add(Sender(2, 70), "theirs too")
    assert [turns.take() for _ in range(4)] == [
        "flooding 0",
        "theirs",
        "flooding 1",
        "theirs too",
    ]


def test_who_may_not_be_taken_keeps_its_turn() -> None:
    turns: Turns[str] = Turns()
    for uid, one in enumerate(("a", "b")):
        turns.add(Sender(uid, uid), one)
    assert turns.take(lambda one: one == "b") == "b"
    assert turns.take(lambda one: one == "b") is None
    assert turns.take() == "a"
