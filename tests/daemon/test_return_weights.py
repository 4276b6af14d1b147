"""For how long a return's weight counts."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.safety.return_weights import ReturnWeights

WINDOW_NS = 1_000


def test_before_the_first_call_all_weights_are_one() -> None:
    weights = ReturnWeights(3, WINDOW_NS)
    assert weights.of == [1.0] * 3
    assert weights.most == 1.0


def test_a_larger_weight_counts_at_once_and_is_told() -> None:
    weights = ReturnWeights(3, WINDOW_NS)
    assert weights.set([0.5, 3.0, 1.0], 0)
    assert weights.of == [1.0, 3.0, 1.0]
    assert weights.most == 3.0
    assert not weights.set([0.5, 3.0, 0.5], 1)
    assert weights.set([1.5, 2.0, 0.5], 2)
    assert weights.of == [1.5, 3.0, 1.0]


def test_a_smaller_weight_counts_after_the_window() -> None:
    weights = ReturnWeights(2, WINDOW_NS)
    found = []
    for at_ns in range(5_000, 8_000, 500):
        assert not weights.set([0.5, 0.25], at_ns)
        found.append(weights.of)
    assert found == [[1.0, 1.0]] * 4 + [[0.5, 0.25]] * 2
    assert weights.most == 0.5


def test_weights_are_of_all_electrodes() -> None:
    with pytest.raises(ValueError, match="zip"):
        ReturnWeights(3, WINDOW_NS).set([1.0, 1.0], 0)


@given(
    st.integers(0, 5 * WINDOW_NS),
    st.lists(st.tuples(st.integers(1, WINDOW_NS // 2), st.floats(0.1, 10.0)), min_size=1),
)
def test_a_weight_counts_for_a_window_after_it_was_replaced_and_for_two_and_a_call_at_most(
    begin_ns: int, drawn: list[tuple[int, float]]
) -> None:
    weights, now_ns, last = ReturnWeights(1, WINDOW_NS), begin_ns, 1.0
    #: When each was replaced.
    ended: list[tuple[int, float]] = []
    for apart_ns, weight in drawn:
        now_ns += apart_ns
        ended.append((now_ns, last))
        weights.set([weight], now_ns)
        last = weight
        least = max([weight, *(one for end_ns, one in ended if now_ns - end_ns < WINDOW_NS)])
        most_ns = 2 * WINDOW_NS + WINDOW_NS // 2
        most = max([weight, *(one for end_ns, one in ended if now_ns - end_ns <= most_ns)])
        assert least <= weights.of[0] <= most
        assert weights.most == weights.of[0]
