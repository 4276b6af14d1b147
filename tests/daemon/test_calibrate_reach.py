"""Ascending into the unknown, never past the cap: whatever a procedure wishes for."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.calibrate.answers import Answer
from etd.calibrate.comfortable import Comfortable, comfortable
from etd.calibrate.reach import LEAST_UA, RISE, Reach
from etd.calibrate.trial import MOST_PRESENTATIONS, Heard, Procedure, Stopped, Unsettled, run

ANSWERS = st.sampled_from(["not_felt", "felt", "comfortable", "too_strong"])
CAPS = st.integers(50, 10_000)


def wishing(requests: list[float]) -> Procedure[None]:
    for pulse_request in requests:  # noqa: UP028 - what is sent goes nowhere
        yield pulse_request


@given(
    cap_ua=CAPS,
    start_ua=st.integers(1, 12_000),
    said=st.lists(st.tuples(st.floats(0, 1e5), ANSWERS), max_size=60),
)
def test_nothing_goes_past_the_cap_nor_far_into_the_unknown(
    cap_ua: int, start_ua: int, said: list[tuple[float, Answer]]
) -> None:
    reach = Reach(cap_ua, start_ua)
    answers = iter([answer for _, answer in said])
    presented: list[int] = []
    tolerated_ua, ceiling_ua = 0, cap_ua

    def present(current_ua: int) -> Answer:
        nonlocal tolerated_ua, ceiling_ua
        known_ua = tolerated_ua * RISE if tolerated_ua else max(start_ua, LEAST_UA)
        assert current_ua <= max(known_ua, tolerated_ua + 1)
        assert current_ua <= ceiling_ua
        presented.append(current_ua)
        answer = next(answers)
        if answer == "too_strong":
            ceiling_ua = min(ceiling_ua, current_ua - 1)
        else:
            tolerated_ua = max(tolerated_ua, current_ua)
        return answer

    run(wishing([pulse_request for pulse_request, _ in said]), reach, present)
    assert len(presented) == len(said)


def test_what_was_too_strong_leaves_what_was_tolerated_below_it() -> None:
    reach = Reach(3_000, 500)
    reach.update(500, "felt")
    reach.update(550, "too_strong")
    assert (reach.cap_ua, reach.bounded(9_000)) == (500, 500)
    reach.update(500, "too_strong")
    assert reach.bounded(9_000) < 500


def test_where_more_was_tolerated_before_what_was_tolerated_last_is_left() -> None:
    """So that a cap that was just accepted stays one."""
    reach = Reach(3_000, 600)
    for current_ua in (600, 500, 520):
        reach.update(current_ua, "felt")
    assert reach.left_below(540) == 520
    reach.update(540, "too_strong")
    assert (reach.cap_ua, reach.tolerated_ua) == (520, 520)
    reach.update(520, "too_strong")
    assert reach.cap_ua == 472


@pytest.mark.parametrize("answer", ["stop", "pause"])
def test_a_stop_and_a_pause_end_it_before_the_next_presentation(answer: Answer) -> None:
    answers = iter(["not_felt", answer])
    presented = []

    def present(current_ua: int) -> Answer:
        presented.append(current_ua)
        return next(answers)

    with pytest.raises(Stopped) as stopped:
        run(wishing([100.0, 110.0, 120.0]), Reach(3_000, 100), present)
    assert stopped.value.answer == answer
    assert presented == [100, 110]


def test_what_does_not_settle_is_given_up() -> None:
    def for_ever() -> Procedure[None]:
        while True:
            yield 100.0

    with pytest.raises(Unsettled) as given_up:
        run(for_ever(), Reach(3_000, 100), lambda _: "felt")
    assert given_up.value.presentations == MOST_PRESENTATIONS


def comfortable_said(said: list[Answer]) -> tuple[Comfortable, list[int]]:
    """The answers in turn, then `felt`."""
    presented: list[int] = []

    def present(current_ua: int) -> Answer:
        presented.append(current_ua)
        return said[len(presented) - 1] if len(presented) <= len(said) else "felt"

    return run(comfortable(1_000), Reach(3_000, 1_000, 1_000), present), presented


def test_a_comfortable_level_is_felt_twice_before_it_is_one() -> None:
    found, presented = comfortable_said(["felt", "felt", "comfortable", "comfortable"])
    assert presented[:5] == [1_000, 1_050, 1_102, 1_102, 1_157]
    assert found == Comfortable(1_102, round(1_102 * 1.2))


def test_a_key_that_slipped_sets_no_level() -> None:
    found, presented = comfortable_said(
        ["comfortable", "felt", "felt", "comfortable", "not_felt", "comfortable", "comfortable"]
    )
    assert presented[:7] == [1_000, 1_000, 1_050, 1_102, 1_102, 1_157, 1_157]
    assert found.comfortable_ua == 1_157


def test_what_is_too_strong_when_it_is_felt_again_is_not_accepted() -> None:
    found, presented = comfortable_said(["felt", "felt", "comfortable", "too_strong"])
    assert presented == [1_000, 1_050, 1_102, 1_102, 1_001]
    assert found == Comfortable(1_001, 1_001)


def comfortable_with(
    said: dict[int, Answer], cap_ua: int = 3_000, tolerated_ua: int = 1_000
) -> tuple[Comfortable, list[int]]:
    """Answers by the least current that they hold from; the presentations, besides."""
    presented: list[int] = []

    def present(current_ua: int) -> Answer:
        presented.append(current_ua)
        return [answer for least, answer in said.items() if current_ua >= least][-1]

    reach = Reach(cap_ua, 1_000, tolerated_ua)
    return run(comfortable(1_000), reach, present), presented


def test_the_cap_is_the_strongest_that_was_accepted_a_fifth_above_comfortable() -> None:
    found, presented = comfortable_with({0: "felt", 1_500: "comfortable"})
    assert 1_500 <= found.comfortable_ua <= 1_500 * 1.05
    assert found.cap_ua == max(presented) == round(found.comfortable_ua * 1.2)


def test_the_first_too_strong_ends_the_ascent_and_is_above_the_cap() -> None:
    found, presented = comfortable_with({0: "felt", 1_500: "comfortable", 1_650: "too_strong"})
    assert found.comfortable_ua <= found.cap_ua < 1_650
    assert sum(electrode >= 1_650 for electrode in presented) == 1


def test_where_it_is_too_strong_before_it_is_comfortable_what_was_accepted_is_both() -> None:
    found, _ = comfortable_with({0: "felt", 1_200: "too_strong"})
    assert found.comfortable_ua == found.cap_ua < 1_200


def test_where_even_the_threshold_is_too_strong_it_goes_down() -> None:
    found, presented = comfortable_with({0: "felt", 900: "too_strong"})
    assert found.comfortable_ua == found.cap_ua < 900
    assert presented == sorted(presented, reverse=True)


def test_the_cap_in_force_ends_it() -> None:
    found, presented = comfortable_with({0: "felt"}, cap_ua=1_300)
    assert found == Comfortable(1_300, 1_300)
    assert max(presented) == 1_300


def test_what_a_procedure_hears_tells_why_there_is_no_more() -> None:
    heard: list[Heard] = []

    def listening() -> Procedure[None]:
        for _ in range(3):
            heard.append((yield 9_000.0))

    answers = iter(["felt", "too_strong", "not_felt"])
    run(listening(), Reach(3_000, 100), lambda _: next(answers))  # type: ignore[arg-type]
    assert [one.is_at_cap for one in heard] == [False, True, True]
    assert [one.is_cap_felt for one in heard] == [False, True, True]
