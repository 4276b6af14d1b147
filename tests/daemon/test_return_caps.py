"""Which return comes to its cap first."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.safety.return_caps import Known, ReturnCaps
from etd_body.electrode import Contact, skin
from return_network import carried_parts

#: Read with next to no current: no bend of the skin between that and the cap.
EVEN = Known(20e-6, 20e-6, 100.0, touches=True)
OPEN = Known(0.0, 0.0, 300.0, touches=False)


def bounds(caps_ua: list[int], *known: Known | None) -> ReturnCaps:
    return ReturnCaps(caps_ua, known)


def test_one_that_is_not_known_may_carry_it_all() -> None:
    assert bounds([4_000, 300, 4_000], EVEN, None, EVEN).of(0) == (300.0, 1)


def test_one_that_is_not_known_takes_nothing_off_what_others_carry() -> None:
    wet = Known(2e-4, 2e-4, 100.0, touches=True)
    alone = bounds([100, 4_000, 4_000], wet, EVEN, EVEN).of(1)
    beside = bounds([100, 4_000, 4_000, 4_000], wet, EVEN, EVEN, None).of(1)
    # It counts a tenth of its current for the one other that is left beside it.
    assert alone == beside
    assert alone[0] == pytest.approx(110, rel=0.01)


def test_each_electrode_has_a_cap() -> None:
    with pytest.raises(ValueError, match="zip"):
        bounds([100, 4_000], EVEN, EVEN, EVEN)


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
    dry, wet = Known(6.6e-6, 6.6e-6, 100.0, touches=True), Known(5e-4, 5e-4, 100.0, touches=True)
    found = bounds([400] * 15 + [1_000], *[dry] * 15, wet)
    current_ua, electrode = found.of(0)
    assert electrode == 15
    assert current_ua == pytest.approx(1_000 / 0.86, rel=0.1)
    # Its own pulses return through the others alone, each with one part in fifteen.
    assert found.of(15)[0] == pytest.approx(400 * 15, rel=0.1)


def test_one_that_is_open_counts_for_an_equal_part_once_it_is_touched() -> None:
    assert bounds([100, 4_000, 4_000], OPEN, EVEN, EVEN).of(1) == (200.0, 0)
    # It would be the only return.
    assert bounds([100, 4_000, 4_000], OPEN, EVEN, OPEN).of(1) == (100.0, 0)
    assert bounds([100, 100], *[OPEN] * 2).of(0) == (100.0, 1)


def test_skin_is_taken_to_conduct_better_at_its_cap_and_worse_beside_it_than_it_was_read() -> None:
    weak = Known(20e-6, 20e-6, 300.0, touches=True)
    strong = Known(20e-6, 20e-6, 3_000.0, touches=True)
    by_weak = bounds([1_000] * 8, *[weak] * 8).of(0)[0]
    by_strong = bounds([1_000] * 8, *[strong] * 8).of(0)[0]
    assert weak.as_return_s(1_000) == pytest.approx(20e-6 * 9.0 / 8.3)
    assert strong.as_return_s(1_000) == 20e-6
    assert strong.as_other_s == pytest.approx(20e-6 * 8.0 / 11.0)
    assert by_strong < by_weak < 7_000


def test_one_that_resists_more_counts_for_an_equal_part_as_long_as_it_touches() -> None:
    """It has a capacitance like the others', which carries as much at the beginning of a pulse."""
    dry = Known(2e-6, 2e-6, 100.0, touches=True)
    assert bounds([4_000] * 8 + [100], *[EVEN] * 8, dry).of(0) == (800.0, 8)


#: Series resistance and capacitance are of the area, which is much the same for all; how skin
#: resists is not.
areas, parallel_ohm = st.floats(0.8, 1.2), st.floats(math.log(2e3), math.log(5e5)).map(math.exp)
like_areas = st.builds(lambda area, ohm: skin(2e3 / area, ohm, 0.3 * area), areas, parallel_ohm)


@given(st.lists(like_areas, min_size=3, max_size=10), st.data())
def test_no_return_gets_much_more_than_its_cap_while_capacitances_are_charged(
    contacts: list[Contact], data: st.DataObject
) -> None:
    """Every return in full. What areas differ is what caps are passed by: 1.2 by 0.8."""
    caps_ua = [data.draw(st.sampled_from([50, 100, 4_000])) for _ in contacts]
    known = [
        Known(contact.conductance_s, contact.conductance_s, 0.0, touches=True)
        for contact in contacts
    ]
    current_ua, _ = ReturnCaps(caps_ua, known).of(0)
    for parts in carried_parts(contacts[1:], (0.0, 1.0, 3.0, 10.0, 20.0, 50.0, 100.0, 200.0)):
        for part, cap_ua in zip(parts, caps_ua[1:], strict=True):
            assert current_ua * part <= cap_ua * 1.5 + 1e-6


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
        None
        if one is None
        else Known(one[0] * one[1], one[0] * one[2], float(one[3]), touches=True)
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
