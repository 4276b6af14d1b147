"""Which return comes to its cap first."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.safety.return_caps import Known, ReturnCaps

#: Read with next to no current: no bend of the skin between that and the cap.
EVEN = Known(20e-6, 20e-6, 100.0)


def bounds(caps_ua: list[int], *known: Known | None) -> ReturnCaps:
    return ReturnCaps(caps_ua, known)


def test_one_that_is_not_known_may_carry_it_all() -> None:
    assert bounds([4_000, 300, 4_000], EVEN, None, EVEN).of(0) == (300.0, 1)


def test_of_those_that_are_alike_the_one_with_the_smallest_cap_comes_to_it_first() -> None:
    found = bounds([4_000] * 8 + [100], *[EVEN] * 9)
    current_ua, electrode = found.of(0)
    assert electrode == 8
    # 100 uA in one of eight, less what skin bends between 100 uA and nothing.
    assert current_ua == pytest.approx(800, rel=0.02)


def test_the_stimulated_one_is_not_its_own_return() -> None:
    found = bounds([100, 200, 4_000], None, None, None)
    assert found.of(0) == (200.0, 1)
    assert found.of(1) == (100.0, 0)


def test_one_that_conducts_better_comes_to_a_larger_cap_before_others() -> None:
    wet = Known(500e-6, 500e-6, 100.0)
    found = bounds([400] * 15 + [1_000], *[Known(6.6e-6, 6.6e-6, 100.0)] * 15, wet)
    current_ua, electrode = found.of(0)
    assert electrode == 15
    assert current_ua == pytest.approx(1_000 / 0.86, rel=0.1)
    # Its own pulses return through the others alone, each with one part in fifteen.
    assert found.of(15)[0] == pytest.approx(400 * 15, rel=0.1)


def test_one_that_is_open_never_comes_to_its_cap() -> None:
    found = bounds([100, 4_000, 4_000], Known(0.0, 0.0, 300.0), EVEN, EVEN)
    assert found.of(1)[0] >= 4_000
    assert bounds([100, 100], *[Known(0.0, 0.0, 300.0)] * 2).of(0)[0] >= 50_000


def test_skin_is_taken_to_conduct_better_at_its_cap_and_worse_beside_it_than_it_was_read() -> None:
    weak, strong = Known(20e-6, 20e-6, 300.0), Known(20e-6, 20e-6, 3_000.0)
    by_weak = bounds([1_000] * 8, *[weak] * 8).of(0)[0]
    by_strong = bounds([1_000] * 8, *[strong] * 8).of(0)[0]
    assert weak.as_return_s(1_000) == pytest.approx(20e-6 * 9.0 / 8.3)
    assert strong.as_return_s(1_000) == 20e-6
    assert strong.as_other_s == pytest.approx(20e-6 * 8.0 / 11.0)
    assert by_strong < by_weak < 7_000


conductances = st.tuples(
    st.floats(1e-6, 1e-3), st.floats(0.2, 1.0), st.floats(1.0, 5.0), st.integers(50, 4_000)
)


@given(st.lists(st.none() | conductances, min_size=2, max_size=12), st.data())
def test_whatever_lies_between_the_bounds_no_return_gets_more_than_its_cap(
    drawn: list[tuple[float, float, float, int] | None], data: st.DataObject
) -> None:
    """One that is not known conducts whatever it likes."""
    caps_ua = [data.draw(st.integers(10, 4_000)) for _ in drawn]
    true_s = [data.draw(st.floats(1e-7, 1e-2)) if one is None else one[0] for one in drawn]
    known = [
        None if one is None else Known(one[0] * one[1], one[0] * one[2], float(one[3]))
        for one in drawn
    ]
    found = ReturnCaps(caps_ua, known)
    for stimulated in range(len(drawn)):
        current_ua, _ = found.of(stimulated)
        whole_s = sum(true_s) - true_s[stimulated]
        for electrode in range(len(drawn)):
            if electrode != stimulated:
                carried_ua = current_ua * true_s[electrode] / whole_s
                assert carried_ua <= caps_ua[electrode] * (1.0 + 1e-9)
