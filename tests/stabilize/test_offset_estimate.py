"""The estimate of how much stronger or weaker it is wanted, of answers that may be wrong."""

from __future__ import annotations

from typing import get_args

from hypothesis import given
from hypothesis import strategies as st

from etd.stabilize.offset_estimate import Answer, OffsetEstimate

MINUTE = 60_000_000_000


def test_what_was_said_is_forgotten_in_the_estimate() -> None:
    estimate = OffsetEstimate()
    for minute in range(5):
        estimate.hear("too_weak", 0.0, minute * MINUTE)
    soon, late = estimate.mean(5 * MINUTE), estimate.mean(60 * MINUTE)
    assert soon > 0.1
    assert 0.0 < late < 0.01


@given(st.lists(st.tuples(st.sampled_from(get_args(Answer)), st.integers(0, 20 * MINUTE))))
def test_too_strong_never_raises_the_estimate_and_too_weak_never_lowers_it(
    said: list[tuple[Answer, int]],
) -> None:
    estimate, now_ns = OffsetEstimate(), 0
    for answer, after_ns in said:
        now_ns += after_ns
        before = estimate.mean(now_ns)
        estimate.hear(answer, 0.0, now_ns)
        change = estimate.mean(now_ns) - before
        assert {"too_strong": change <= 1e-9, "too_weak": change >= -1e-9, "good": True}[answer]
