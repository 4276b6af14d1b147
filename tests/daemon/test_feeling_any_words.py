"""Any words, as many as there may be: the engine goes on, and what was taken stays taken."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.engine.feeling import Feeling
from etd.protocol.link import SayFelt
from etd.stabilize.offset_estimate import Answer

S = 1_000_000_000
COUNT = 3

#: What is said, of which, with the lease, how often, and how long after the last one.
Words = tuple[Answer, tuple[int, ...] | None, bool, int, int]


def heard(feeling: Feeling, words: list[Words], fired_ua: int, wanted_ua: int) -> None:
    """Between words its electrodes are fired."""
    now_ns = 0
    for answer, electrodes, is_holder, times, after_ns in words:
        now_ns += after_ns
        for electrode in range(COUNT):
            feeling.fired(electrode, 1.0, now_ns, fired_ua, wanted_ua, wanted_ua)
        lease = "a" if is_holder or answer != "too_strong" else None
        for _ in range(times):
            word = SayFelt(ref=1, answer=answer, electrodes=electrodes, lease=lease)
            feeling.hear(word, now_ns)
            assert feeling.facts() is not None
            for electrode in range(COUNT):
                feeling.felt_ua(electrode, 1_000, may_be_raised=True)


@pytest.mark.parametrize("about", [None, (0,)])
@pytest.mark.parametrize(("fired_ua", "wanted_ua"), [(998, 3_720), (3_720, 3_720), (0, 10)])
def test_thousands_of_words_end_nothing(
    about: tuple[int, ...] | None, fired_ua: int, wanted_ua: int
) -> None:
    """A client without the lease can repeat itself as long as it likes."""
    feeling = Feeling(COUNT, may_raise=False)
    flood: Words = ("too_strong", about, False, 3_000, 0)
    after: list[Words] = [("good", about, True, 1, 0), ("too_weak", about, True, 2, 30 * S)]
    heard(feeling, [flood, *after, flood, *after], fired_ua, wanted_ua)
    left_ua = feeling.felt_ua(0, 3_720, may_be_raised=False)
    assert left_ua is not None
    assert left_ua < 1


@given(
    words=st.lists(
        st.tuples(
            st.sampled_from(["too_strong", "too_weak", "good"]),
            st.sampled_from([None, (0,), (1, 2)]),
            st.booleans(),
            st.sampled_from([1, 2, 30]),
            st.integers(0, 59 * S),
        ),
        max_size=6,
    ),
    fired_ua=st.integers(0, 3_000),
    wanted_ua=st.integers(0, 3_000),
)
def test_no_words_raise(words: list[Words], fired_ua: int, wanted_ua: int) -> None:
    feeling = Feeling(COUNT, may_raise=True)
    heard(feeling, words, fired_ua, wanted_ua)
