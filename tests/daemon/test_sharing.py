"""What one of all others may carry: by conductance, and only while it is known."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.engine.sharing import FRESH_NS, TOLERANCE, Sharing

OHM = 50_000
WIDTH_US = 100


def seen(*path_ohm: int | None, at_ns: int = 0) -> Sharing:
    """Electrodes that each had a probe pulse."""
    sharing = Sharing(len(path_ohm))
    for electrode, ohm in enumerate(path_ohm):
        sharing.learn(electrode, 20, ohm, at_ns)
    return sharing


def test_where_nothing_is_known_one_return_may_carry_it_all() -> None:
    assert Sharing(4).largest(0, 0) == 1.0


def test_equal_returns_share_equally() -> None:
    assert seen(*[OHM] * 5).largest(0, 1) == pytest.approx(1 / 4)


def test_a_better_conducting_return_carries_more() -> None:
    assert seen(3 * OHM, OHM, 3 * OHM, 3 * OHM).largest(0, 1) == pytest.approx(3 / 5, rel=1e-4)
    assert seen(3 * OHM, OHM, 3 * OHM, 3 * OHM).largest(1, 1) == pytest.approx(1 / 3, rel=1e-4)


def test_who_does_not_touch_carries_nothing() -> None:
    assert seen(OHM, OHM, None, None, OHM).largest(0, 1) == pytest.approx(1 / 2)


def test_forgetting_is_knowing_nothing() -> None:
    sharing = seen(*[OHM] * 4)
    sharing.forget()
    assert sharing.largest(0, 1) == 1.0


def test_in_silence_nothing_is_forgotten() -> None:
    assert seen(*[OHM] * 5).largest(0, 60 * FRESH_NS) == pytest.approx(1 / 4)


def stimulate(sharing: Sharing, ohm: int | None, from_ns: int, pulses: int = 2) -> int:
    """Pulses of electrode 0, 10 ms apart; the time after them."""
    for pulse in range(pulses):
        sharing.learn(0, WIDTH_US, ohm, from_ns + pulse * 10_000_000)
    return from_ns + pulses * 10_000_000


def test_a_path_that_resists_no_more_vouches_for_the_others_but_for_what_it_could_hide() -> None:
    sharing = seen(*[OHM] * 5)
    now_ns = stimulate(sharing, OHM, 5 * FRESH_NS)
    hidden = TOLERANCE * OHM / OHM
    assert sharing.largest(0, now_ns) == pytest.approx(1 / 4 + hidden)


@pytest.mark.parametrize("ohm", [int(OHM * (1 + TOLERANCE)) + 1, 2 * OHM])
def test_a_path_that_resists_more_takes_back_what_no_visit_told(ohm: int) -> None:
    sharing = seen(*[OHM] * 5)
    now_ns = stimulate(sharing, OHM, 5 * FRESH_NS)
    stimulate(sharing, ohm, now_ns, pulses=1)
    assert sharing.largest(0, now_ns) == 1.0


def test_when_it_resists_as_before_the_others_are_believed_again() -> None:
    sharing = seen(*[OHM] * 5)
    now_ns = stimulate(sharing, OHM, 5 * FRESH_NS)
    now_ns = stimulate(sharing, 2 * OHM, now_ns)
    now_ns = stimulate(sharing, OHM, now_ns, pulses=1)
    assert sharing.largest(0, now_ns) < 1.0


def test_the_least_that_it_ever_resisted_is_the_measure() -> None:
    sharing = seen(*[OHM] * 5)
    now_ns = stimulate(sharing, OHM, 5 * FRESH_NS)
    now_ns = stimulate(sharing, OHM // 2, now_ns)
    now_ns = stimulate(sharing, OHM, now_ns)
    assert sharing.largest(0, now_ns) == 1.0


def test_pulses_that_tell_nothing_are_borne_for_a_second() -> None:
    sharing = seen(*[OHM] * 5)
    begun_ns = 5 * FRESH_NS
    for width_us in range(30, 130):
        sharing.learn(0, width_us, OHM, begun_ns + width_us)
    assert sharing.largest(0, begun_ns + FRESH_NS // 2) < 1.0
    assert sharing.largest(0, begun_ns + FRESH_NS + 30) == 1.0


@pytest.mark.parametrize("is_through_chosen", [True, False])
def test_after_a_contact_was_lost_only_visits_of_the_last_second_count(
    is_through_chosen: bool,
) -> None:
    sharing = seen(*[OHM] * 5)
    if is_through_chosen:
        sharing.lose(4)
    else:
        sharing.learn(4, WIDTH_US, None, FRESH_NS // 2)
    assert sharing.largest(0, FRESH_NS - 1) == pytest.approx(1 / 3, rel=1e-4)
    assert sharing.largest(0, FRESH_NS) == 1.0
    sharing.learn(1, WIDTH_US, OHM, FRESH_NS)
    sharing.learn(2, WIDTH_US, OHM, FRESH_NS)
    assert sharing.largest(0, FRESH_NS + 1) == pytest.approx(1 / 2)


def test_an_electrode_that_never_touched_is_not_lost() -> None:
    sharing = seen(OHM, OHM, OHM, None)
    sharing.learn(3, WIDTH_US, None, 1)
    sharing.lose(3)
    assert sharing.largest(0, 5 * FRESH_NS) == pytest.approx(1 / 2)


@given(
    others_ohm=st.lists(st.integers(5_000, 500_000), min_size=2, max_size=12),
    own_ohm=st.integers(5_000, 500_000),
    lifted=st.sets(st.integers(0, 11)),
)
def test_no_return_carries_more_than_reckoned_however_many_are_lifted(
    others_ohm: list[int], own_ohm: int, lifted: set[int]
) -> None:
    """From the second pulse after it; real paths, and the division of current by conductance."""
    left_ohm = [ohm for one, ohm in enumerate(others_ohm) if one not in lifted]
    if not left_ohm:
        return
    sharing = Sharing(1 + len(others_ohm))
    before_ohm = own_ohm + parallel(others_ohm)
    for electrode, ohm in enumerate([before_ohm, *others_ohm]):
        sharing.learn(electrode, WIDTH_US, ohm, 0)
    now_ns = stimulate(sharing, before_ohm, 5 * FRESH_NS)
    now_ns = stimulate(sharing, own_ohm + parallel(left_ohm), now_ns, pulses=1)
    real = max(1 / ohm for ohm in left_ohm) * parallel(left_ohm)
    assert sharing.largest(0, now_ns) >= real * 0.999


def parallel(ohms: list[int]) -> int:
    return round(1 / sum(1 / ohm for ohm in ohms))
