"""Settling as a rule: what part a contact gets that touched again, and until when."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.protocol.messages import ContactState
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.settling import LEAST_PART, NEW_NS, NEW_PART, Settling
from plain_records import changed

MS = 1_000_000
FIRM_OHM = 30_000
K = 0.6
FIRM = ElectrodeEstimate(
    3,
    state="closed",
    skin_ohm=float(FIRM_OHM),
    skin_at_ua=3_000,
    reference_ohm=FIRM_OHM,
    reference_at_ua=3_000,
    exponent=K,
)
OPEN = changed(FIRM, state="open", skin_ohm=None)
STEP_NS = 100 * MS


def settling() -> Settling:
    return Settling(goes_by_resistance=True)


def after_a_return(
    estimate: ElectrodeEstimate, seconds: float, law: Settling | None = None
) -> list[float]:
    """A firm contact comes off, and is `known` from then on: the part at each tenth of a second."""
    law_under_test = law or settling()
    assert law_under_test.part(FIRM) == 1.0
    law_under_test.part(changed(OPEN, now_ns=STEP_NS))
    steps = range(2, 2 + round(seconds * 10))
    return [law_under_test.part(changed(estimate, now_ns=step * STEP_NS)) for step in steps]


def test_a_contact_that_nothing_happened_to_gets_all() -> None:
    law_under_test = settling()
    lighter = changed(FIRM, skin_ohm=3.0 * FIRM_OHM)
    assert all(
        law_under_test.part(changed(lighter, now_ns=step * STEP_NS)) == 1.0 for step in range(100)
    )


def test_a_return_as_firm_as_before_gets_a_part_for_three_seconds_and_then_rises_slowly() -> None:
    parts = after_a_return(FIRM, 8.0)
    assert parts[:29] == [NEW_PART] * 29
    assert parts[49] == pytest.approx(0.9, abs=0.01)
    assert parts[-1] == 1.0
    rises = [later - earlier for earlier, later in pairwise(parts)]
    assert max(rises) < 0.006, "not felt as a step of its own"


def test_a_return_that_resists_more_gets_less_until_it_does_not() -> None:
    law = settling()
    lighter = changed(FIRM, skin_ohm=2.0 * FIRM_OHM)
    parts = after_a_return(lighter, 8.0, law)
    assert parts[0] == pytest.approx(NEW_PART * 0.5**K)
    assert 0.66 < parts[-1] < 0.78, "in the end only what it resists is taken"
    firm_again = [law.part(changed(FIRM, now_ns=(90 + step) * STEP_NS)) for step in range(20)]
    assert firm_again[-1] == 1.0


def test_a_finger_that_stays_lighter_comes_to_its_strength_in_the_end() -> None:
    parts = after_a_return(changed(FIRM, skin_ohm=1.5 * FIRM_OHM), 240.0)
    assert parts[100] < 0.95
    assert parts[-1] > 0.98


def test_the_part_leaves_enough_to_measure_by() -> None:
    assert min(after_a_return(changed(FIRM, skin_ohm=100.0 * FIRM_OHM), 3.0)) == LEAST_PART


def test_a_weaker_pulse_of_the_same_skin_does_not_look_like_a_smaller_contact() -> None:
    weaker_ohm = FIRM_OHM * (3_000 + 8_000) / (1_000 + 8_000)
    same = changed(FIRM, skin_ohm=weaker_ohm, skin_at_ua=1_000)
    assert after_a_return(same, 1.0)[-1] == pytest.approx(NEW_PART)


def test_a_finger_just_laid_on_is_compared_with_the_calibration() -> None:
    law_under_test = settling()
    law_under_test.part(OPEN)
    dry = changed(FIRM, skin_ohm=2.0 * FIRM_OHM, now_ns=STEP_NS)
    assert law_under_test.part(dry) == pytest.approx(NEW_PART * 0.5**K)


def test_behind_it_a_law_by_resistance_answers_the_area_itself() -> None:
    law = Settling(goes_by_resistance=False)
    parts = after_a_return(changed(FIRM, skin_ohm=2.0 * FIRM_OHM), 8.0, law)
    assert parts[:29] == [NEW_PART] * 29
    assert parts[49] == pytest.approx(0.9, abs=0.01)
    assert parts[-1] == 1.0


@pytest.mark.parametrize("resists", [0.5, 2.0, 10.0])
def test_a_person_whose_thresholds_were_not_found_to_follow_it_gets_the_part_by_time_alone(
    resists: float,
) -> None:
    nobodys = changed(FIRM, exponent=None)
    parts = after_a_return(changed(nobodys, skin_ohm=resists * FIRM_OHM), 8.0)
    assert parts == after_a_return(nobodys, 8.0)
    assert parts[0] == NEW_PART


@pytest.mark.parametrize("k", [-0.5, -2.0, 0.0])
def test_a_threshold_that_rises_where_resistance_falls_is_settled_by_time_alone(k: float) -> None:
    """Where ducts carry the current, less resistance is felt less: the part by area would err."""
    wrong_way = changed(FIRM, skin_ohm=2.25 * FIRM_OHM, exponent=k)
    assert after_a_return(wrong_way, 12.0) == after_a_return(
        changed(wrong_way, exponent=None), 12.0
    )


@pytest.mark.parametrize("k", [0.2, 0.6, 1.1, 2.0])
def test_the_part_falls_as_the_persons_own_threshold_does(k: float) -> None:
    lighter = changed(FIRM, skin_ohm=1.5 * FIRM_OHM, exponent=k)
    assert after_a_return(lighter, 1.0)[0] == pytest.approx(max(LEAST_PART, NEW_PART * 1.5**-k))


def test_without_a_calibration_all_is_given() -> None:
    unknown = changed(FIRM, reference_ohm=None, reference_at_ua=None)
    law_under_test = settling()
    law_under_test.part(changed(unknown, state="open"))
    assert law_under_test.part(changed(unknown, now_ns=STEP_NS)) == 1.0


def test_a_resistance_that_is_not_believed_takes_nothing_more_and_holds_nothing_up() -> None:
    parts = after_a_return(changed(FIRM, skin_ohm=None), 8.0)
    assert parts[0] == NEW_PART
    assert parts[-1] == 1.0


def test_a_contact_that_shrank_begins_anew() -> None:
    law = settling()
    assert after_a_return(FIRM, 8.0, law)[-1] == 1.0
    shrank = changed(FIRM, state="soft", firmness=0.0, now_ns=90 * STEP_NS)
    assert law.part(shrank) == NEW_PART
    later = changed(FIRM, now_ns=90 * STEP_NS + NEW_NS // 2)
    assert law.part(later) == NEW_PART


@given(
    seen=st.lists(
        st.tuples(
            st.sampled_from(("unknown", "open", "soft", "closed", "saturated", "shorted")),
            st.floats(0.0, 1.0),
            st.one_of(st.none(), st.floats(1e3, 2e6)),
            st.integers(0, 10_000),
        ),
        max_size=40,
    )
)
def test_the_part_is_always_one(
    seen: list[tuple[ContactState, float, float | None, int]],
) -> None:
    law = settling()
    for step, (state, firmness, skin_ohm, at_ua) in enumerate(seen):
        estimate = changed(
            FIRM,
            state=state,
            firmness=firmness,
            skin_ohm=skin_ohm,
            skin_at_ua=at_ua,
            now_ns=step * STEP_NS,
        )
        assert LEAST_PART <= law.part(estimate) <= 1.0


def test_short_pulses_are_compared_with_a_calibration_made_with_short_ones() -> None:
    """What their beginning makes expected is not what the end of a wider one tells."""
    firm = changed(
        FIRM, skin_ohm=0.6 * FIRM_OHM, early_ohm=float(FIRM_OHM), is_reference_early=True
    )
    law = settling()
    law.part(changed(firm, state="open", skin_ohm=None, early_ohm=None))
    assert law.part(changed(firm, now_ns=STEP_NS)) == pytest.approx(NEW_PART)
    lighter = changed(firm, early_ohm=2.0 * FIRM_OHM, now_ns=2 * STEP_NS)
    assert law.part(lighter) == pytest.approx(NEW_PART * 0.5**K)


@pytest.mark.parametrize("is_early", [False, True])
def test_a_resistance_that_rose_with_the_last_pulse_is_answered_with_the_next(
    is_early: bool,
) -> None:
    mean = changed(FIRM, early_ohm=float(FIRM_OHM), is_reference_early=is_early, now_ns=2 * STEP_NS)
    risen_ohm = 1.2 * FIRM_OHM
    law = settling()
    law.part(FIRM)
    law.part(changed(OPEN, now_ns=STEP_NS))
    risen = changed(mean, latest_ohm=risen_ohm, latest_early_ohm=risen_ohm)
    assert law.part(risen) == pytest.approx(NEW_PART * 1.2**-K)


def test_a_lowest_resistance_is_forgotten_as_fast_at_two_pulses_a_second() -> None:
    law = settling()
    law.part(changed(FIRM, skin_ohm=0.5 * FIRM_OHM))
    law.part(changed(OPEN, now_ns=STEP_NS))
    parts = [law.part(changed(FIRM, now_ns=step * 5 * STEP_NS)) for step in range(1, 120)]
    assert parts[-1] > 0.97


def test_one_reading_that_is_too_low_makes_no_contact_of_the_past_firmer_than_it_was() -> None:
    law_under_test, lied_to = settling(), settling()
    before = [changed(FIRM, now_ns=step * STEP_NS) for step in range(-10, 0)]
    wrong = changed(before[5], skin_ohm=0.3 * FIRM_OHM)
    for estimate in before:
        law_under_test.part(estimate)
        lied_to.part(wrong if estimate is before[5] else estimate)
    assert after_a_return(FIRM, 8.0, lied_to) == after_a_return(FIRM, 8.0, law_under_test)


def test_two_of_them_do() -> None:
    """As a finger that was pressed for a moment does: what is lighter then is a part of it."""
    law_under_test = settling()
    for step in range(-10, -8):
        law_under_test.part(changed(FIRM, skin_ohm=0.3 * FIRM_OHM, now_ns=step * STEP_NS))
    assert after_a_return(FIRM, 3.0, law_under_test)[0] < 0.7 * NEW_PART
