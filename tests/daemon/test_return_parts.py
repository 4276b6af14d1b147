"""What part each contact has of all, by the paths of pulses through all others."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.safety.return_parts import likely_parts, most_parts

conductances = st.lists(
    st.floats(-6.0, -3.0).map(lambda power: 10.0**power), min_size=3, max_size=40
)


def paths_of(contacts_s: list[float]) -> list[float]:
    """What the path of each conducts: itself, and all others behind it."""
    whole_s = sum(contacts_s)
    return [own_s * (whole_s - own_s) / whole_s for own_s in contacts_s]


@given(conductances)
def test_the_paths_tell_what_part_each_has(contacts_s: list[float]) -> None:
    whole_s = sum(contacts_s)
    wanted = [own_s / whole_s for own_s in contacts_s]
    assert likely_parts(paths_of(contacts_s)) == pytest.approx(wanted, rel=1e-3, abs=1e-4)


@given(conductances, st.data())
def test_none_has_more_than_it_may_have_at_most(
    contacts_s: list[float], data: st.DataObject
) -> None:
    whole_s, paths_s = sum(contacts_s), paths_of(contacts_s)
    less = [data.draw(st.floats(0.2, 1.0)) for _ in paths_s]
    more = [data.draw(st.floats(1.0, 5.0)) for _ in paths_s]
    least_s = [own_s * times for own_s, times in zip(paths_s, less, strict=True)]
    most_s = [own_s * times for own_s, times in zip(paths_s, more, strict=True)]
    for own_s, most in zip(contacts_s, most_parts(least_s, most_s), strict=True):
        assert own_s / whole_s <= most * (1 + 1e-3) + 1e-4
        assert most <= 1.0


def exactly(least_s: list[float], one: int, most_own_s: float) -> float:
    """With the others at their least, none of which has half: by what they leave of all."""
    others_s = [*least_s[:one], *least_s[one + 1 :]]

    def left(scale: float) -> float:
        return 1.0 - sum(0.5 * (1.0 - math.sqrt(1.0 - 4.0 * scale * s)) for s in others_s)

    low, high = 0.0, 0.25 / max(others_s)
    for _ in range(200):
        scale = 0.5 * (low + high)
        part = max(0.0, left(scale))
        low, high = (scale, high) if scale * most_own_s < part * (1.0 - part) else (low, scale)
    return max(0.0, left(low))


@given(
    st.lists(st.floats(0.5, 1.5), min_size=8, max_size=40),
    st.floats(1.0, 4.0),
)
def test_the_most_is_exact_or_an_eighth_more_at_the_most(own: list[float], times: float) -> None:
    """Where none may have a third of all."""
    least_s = [1e-5 * one for one in own]
    for one, most in enumerate(most_parts(least_s, [times * one_s for one_s in least_s])):
        wanted = exactly(least_s, one, times * least_s[one])
        if wanted < 0.33:
            assert wanted * (1 - 1e-4) <= most <= wanted * 1.125


@pytest.mark.parametrize("times", [3.0, 4.0, 5.0, 5.9])
def test_so_it_is_where_one_may_have_about_half_or_nearly_all(times: float) -> None:
    found = most_parts([1e-5] * 8, [*[1e-5] * 7, times * 1e-5])[7]
    wanted = exactly([1e-5] * 8, 7, times * 1e-5)
    assert wanted * (1 - 1e-4) <= found <= wanted * 1.02


@pytest.mark.parametrize(("count", "most"), [(8, 0.26), (16, 0.13), (64, 0.032)])
def test_where_all_are_read_alike_within_twice_none_has_more_than_about_twice_its_part(
    count: int, most: float
) -> None:
    """Each by itself might carry anything, of eight that are read so."""
    found = most_parts([1e-5] * count, [2e-5] * count)
    assert max(found) == min(found)
    assert 1.0 / count < max(found) <= most


def test_one_whose_path_resists_no_more_than_its_way_back_alone_may_carry_all() -> None:
    assert most_parts([1e-5] * 8, [*[1e-5] * 7, 7e-5])[7] == 1.0
    assert most_parts([1e-5] * 8, [*[1e-5] * 7, math.inf])[7] == 1.0
    # No star has such paths; and of two contacts both paths are the same one.
    assert likely_parts([*[1e-5] * 3, 4e-5]) == pytest.approx([1 / 7] * 3 + [4 / 7])
    assert likely_parts([1e-5, 1e-5]) == [0.5, 0.5]


def test_beside_one_that_has_more_than_half_each_other_one_has_less() -> None:
    contacts_s = [1e-5, 2e-5, 3e-5, 2e-4]
    paths_s = paths_of(contacts_s)
    found = most_parts([0.9 * own_s for own_s in paths_s], [1.1 * own_s for own_s in paths_s])
    for own_s, most in zip(contacts_s[:3], found[:3], strict=True):
        assert own_s / 2.6e-4 < most < 0.5
    assert 2e-4 / 2.6e-4 < found[3] <= 1.0
    # The others' paths cannot conduct less beside it: it has half, and they as much.
    assert most_parts([1e-5] * 3 + [2.9e-5], [2e-5] * 3 + [2.9e-5])[0] == pytest.approx(
        0.5 - math.sqrt(0.25 - 0.25 * 2e-5 / 2.9e-5), rel=1e-3
    )


def test_what_is_read_as_nothing_has_no_part() -> None:
    assert most_parts([1e-5, 1e-5, 1e-5, 0.0], [2e-5, 2e-5, 2e-5, 0.0])[3] == 0.0
