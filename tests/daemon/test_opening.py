"""How fast current may rise."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from etd.engine.opening import Opening, Ramp

MS = 1_000_000
START_NS = 5_000 * MS


def test_the_ceiling_starts_at_zero_and_rises_half_a_milliampere_in_100_ms() -> None:
    ramp = Ramp(8_000)
    risen_ua = [ramp.rise(START_NS + 100 * step * MS) for step in range(11)]
    assert risen_ua == [500 * step for step in range(11)]


def test_the_ceiling_ends_at_the_top() -> None:
    ramp = Ramp(8_000)
    risen_ua = [ramp.rise(START_NS + 100 * step * MS) for step in range(19)]
    assert risen_ua[15:] == [7_500, 8_000, 8_000, 8_000]
    assert ramp.is_done


def test_while_no_frame_stands_the_ceiling_stays() -> None:
    ramp = Ramp(8_000)
    ramp.rise(START_NS)
    ramp.rise(START_NS + 100 * MS)
    ramp.hold()
    assert ramp.rise(START_NS + 900 * MS) == 500
    assert ramp.rise(START_NS + 1_000 * MS) == 1_000


def test_a_restart_falls_to_zero_at_once() -> None:
    ramp = Ramp(8_000)
    ramp.rise(START_NS)
    ramp.rise(START_NS + 500 * MS)
    ramp.restart()
    assert ramp.ceiling_ua == 0
    assert ramp.rise(START_NS + 600 * MS) == 0
    assert ramp.rise(START_NS + 700 * MS) == 500


@given(st.lists(st.integers(min_value=0, max_value=300 * MS), max_size=40), st.data())
def test_it_never_rises_faster_however_often_it_is_asked(
    gaps_ns: list[int], data: st.DataObject
) -> None:
    ramp, now_ns, stood_ns, is_held = Ramp(8_000), START_NS, 0, False
    ramp.rise(now_ns)
    for gap_ns in gaps_ns:
        now_ns += gap_ns
        stood_ns += 0 if is_held else gap_ns
        is_held = data.draw(st.booleans())
        if is_held:
            ramp.hold()
        else:
            assert ramp.rise(now_ns) <= stood_ns * 500 / (100 * MS)
        assert 0 <= ramp.ceiling_ua <= 8_000


def test_many_small_looks_lose_nothing() -> None:
    ramp = Ramp(8_000)
    for tick in range(1_001):
        ramp.rise(START_NS + tick * MS)
    assert ramp.ceiling_ua == 5_000


def test_a_touch_after_none_ramps_that_electrode_alone() -> None:
    opening = Opening(8_000)
    for step in range(11):
        opening.rise(START_NS + 100 * step * MS)
    opening.touched_again(4)
    assert opening.recontact_ua(4, START_NS + 1_000 * MS) == 0
    assert opening.recontact_ua(4, START_NS + 1_100 * MS) == 500
    assert opening.recontact_ua(5, START_NS + 1_100 * MS) is None
    assert opening.ceiling_ua == 5_000


def test_a_ramp_that_has_reached_the_top_is_over() -> None:
    opening = Opening(1_000)
    opening.touched_again(4)
    opening.recontact_ua(4, START_NS)
    opening.recontact_ua(4, START_NS + 100 * MS)
    assert opening.recontact_ua(4, START_NS + 200 * MS) == 1_000
    assert opening.recontact_ua(4, START_NS + 201 * MS) is None


def test_neither_a_stall_nor_visits_far_apart_raise_a_ceiling_by_more_than_half_a_milliamp() -> (
    None
):
    opening = Opening(8_000)
    opening.touched_again(4)
    for now_ns in (START_NS, START_NS + 3_000 * MS):
        risen_ua = (opening.rise(now_ns), opening.recontact_ua(4, now_ns))
    assert risen_ua == (500, 500)


def test_holding_holds_the_single_ramps_too() -> None:
    opening = Opening(8_000)
    opening.touched_again(4)
    opening.recontact_ua(4, START_NS)
    opening.recontact_ua(4, START_NS + 100 * MS)
    opening.hold()
    assert opening.recontact_ua(4, START_NS + 5_000 * MS) == 500


def test_a_restart_forgets_the_single_ramps() -> None:
    opening = Opening(8_000)
    opening.touched_again(4)
    opening.restart()
    assert opening.recontact_ua(4, START_NS) is None
    assert opening.ceiling_ua == 0
