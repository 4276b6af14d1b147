"""A current that a frame names: never raised, and lowered by *too strong* whatever was raised."""

from __future__ import annotations

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.stabilize.offset_estimate import Answer
from etd.stabilize.said import FeltOffsets
from etd.stabilize.said_electrode import LOWERED_BY, MOST

MINUTE = 60_000_000_000
words = st.tuples(
    st.integers(0, 2 * MINUTE), st.booleans(), st.sampled_from([None, *get_args(Answer)])
)


@given(st.lists(words, max_size=40), st.booleans())
def test_it_has_no_more_than_what_is_left_of_any_other(
    story: list[tuple[int, bool, Answer | None]], may_raise: bool
) -> None:
    offsets, now_ns = FeltOffsets(1, may_raise=may_raise), 0
    for after_ns, is_fired, answer in story:
        now_ns += after_ns
        if is_fired:
            offsets.fired(0, now_ns)
        if answer is not None:
            offsets.hear(answer, None, now_ns)
        (factor,) = offsets.factors()
        assert offsets.left(0) <= min(factor, 1.0) + 1e-9
        if not may_raise:
            assert offsets.left(0) == pytest.approx(factor)


def raised(offsets: FeltOffsets, minutes: range) -> None:
    for minute in minutes:
        offsets.fired(0, minute * MINUTE)
        offsets.hear("too_weak", None, minute * MINUTE)


def test_a_rise_is_nothing_that_could_be_taken_from_it() -> None:
    """Raised to the most, taken down once; it comes back with what the rest rises."""
    offsets = FeltOffsets(1, may_raise=True)
    raised(offsets, range(1, 30))
    assert offsets.factors() == pytest.approx([MOST])
    offsets.lower((0,), 30 * MINUTE)
    assert offsets.factors() == pytest.approx([MOST * (1.0 - LOWERED_BY)])
    assert offsets.left(0) == pytest.approx(1.0 - LOWERED_BY)
    raised(offsets, range(31, 60))
    assert offsets.left(0) == pytest.approx(1.0, abs=1e-6)
