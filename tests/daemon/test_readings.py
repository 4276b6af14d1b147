"""The sensors' last values in memory that another process writes."""

from __future__ import annotations

import os

from hypothesis import given
from hypothesis import strategies as st

from etd.sensing.readings import Readings
from etd_hal.shared_memory import SharedMemory

COUNT = 3
VALUES = st.tuples(st.floats(allow_nan=False, allow_infinity=False), st.integers(1, (1 << 62) - 1))


def shared() -> tuple[Readings, Readings]:
    """The reader's, and the writer's."""
    reader = Readings(COUNT)
    memory = SharedMemory(Readings.size(COUNT), os.dup(reader.memory.fd))
    return reader, Readings(COUNT, memory)


def test_a_slot_that_nobody_has_written_has_no_value_and_no_text() -> None:
    reader, _ = shared()
    assert [reader.latest(slot) for slot in range(COUNT)] == [None] * COUNT
    assert [reader.told(slot) for slot in range(COUNT)] == [("", 0)] * COUNT


@given(written=st.lists(st.tuples(st.integers(0, COUNT - 1), VALUES), max_size=20))
def test_each_slot_has_what_was_written_last(
    written: list[tuple[int, tuple[float, int]]],
) -> None:
    reader, writer = shared()
    last: dict[int, tuple[float, int]] = {}
    for slot, (value, t_ns) in written:
        writer.put(slot, value, t_ns)
        last[slot] = (value, t_ns)
        assert reader.latest(slot) == last[slot]
    assert {slot: reader.latest(slot) for slot in last} == last


def test_a_value_that_was_lost_is_none_until_the_next() -> None:
    reader, writer = shared()
    writer.put(1, 300.0, 5)
    assert reader.latest(1) == (300.0, 5)
    writer.lose(1)
    assert reader.latest(1) is None
    writer.put(1, 301.0, 5)
    assert reader.latest(1) == (301.0, 5)


@given(before=VALUES, after=VALUES, arrived=st.sets(st.integers(0, 2)))
def test_half_of_a_value_is_never_taken(
    before: tuple[float, int], after: tuple[float, int], arrived: set[int]
) -> None:
    """Whichever of its words the reader's processor sees first."""
    reader, writer = shared()
    writer.put(0, *before)
    assert reader.latest(0) == before
    old = writer.memory.words[0:3].tolist()
    writer.put(0, *after)
    new = writer.memory.words[0:3].tolist()
    for word in range(3):
        writer.memory.words[word] = new[word] if word in arrived else old[word]
    assert reader.latest(0) in (before, after)
    for word in range(3):
        writer.memory.words[word] = new[word]
    assert reader.latest(0) == after


@given(before=st.text(max_size=600), after=st.text(max_size=600), split=st.integers(0, 520))
def test_half_of_a_text_is_never_taken(before: str, after: str, split: int) -> None:
    reader, writer = shared()
    writer.tell(2, before, 7)
    told = reader.told(2)
    assert before.encode().startswith(told[0].encode())
    begin = 2 * Readings.size(1) + 24
    old = writer.memory.bytes[begin : begin + 496].tobytes()
    writer.tell(2, after, 8)
    new = writer.memory.bytes[begin : begin + 496].tobytes()
    writer.memory.bytes[begin : begin + 496] = new[:split] + old[split:]
    found, since_ns = reader.told(2)
    assert since_ns in (7, 8)
    assert (before if since_ns == 7 else after).encode().startswith(found.encode())


def test_a_text_is_cut_off_where_the_slot_ends_and_never_in_a_character() -> None:
    reader, writer = shared()
    writer.tell(0, "x" + "ä" * 400, 9)
    text, _ = reader.told(0)
    assert text == "x" + "ä" * 239
    assert reader.told(1) == ("", 0)
