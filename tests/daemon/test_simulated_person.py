"""The person that a simulation asks: how chance comes into the answers."""

from __future__ import annotations

import pytest

from etd.calibrate.answers import Answer, Ask, Question
from etd.calibrate.person import Felt, ResponseModel, SimulatedPerson

SURE = ResponseModel(noise=0.0, lapses=0.0)


def asked(person: SimulatedPerson, ask: Ask = "strength", times: int = 1_000) -> list[Answer]:
    return [person.answer(Question(ask, 0), lambda: None) for _ in range(times)]


def test_a_simulated_person_feels_half_of_what_is_at_the_threshold() -> None:
    person = SimulatedPerson(lambda _: Felt(1.0, 0.1), 3)
    assert 450 < asked(person).count("not_felt") < 550
    hurt = SimulatedPerson(lambda _: Felt(2.0, 1.2), 3)
    assert set(asked(hurt, times=50)) == {"too_strong"}


@pytest.mark.parametrize(
    ("model", "felt", "answer", "share"),
    [
        (ResponseModel(noise=0.0, lapses=0.2), Felt(0.0, 0.0), "felt", 0.10),
        (ResponseModel(noise=0.0, lapses=0.2), Felt(1.2, 0.1), "not_felt", 0.10),
        (ResponseModel(noise=0.0, lapses=0.0, false_alarms=0.15), Felt(0.0, 0.0), "felt", 0.15),
        (ResponseModel(noise=0.0, lapses=0.0, false_alarms=0.9), Felt(1.2, 0.0), "not_felt", 0.0),
        (ResponseModel(noise=0.0, lapses=0.0, slips=0.3), Felt(1.2, 0.1), "too_strong", 0.10),
        (ResponseModel(noise=0.0, lapses=0.0, endures=1.5), Felt(2.0, 1.2), "too_strong", 0.0),
        (ResponseModel(noise=0.0, lapses=0.0, endures=1.5), Felt(2.0, 1.3), "too_strong", 1.0),
    ],
)
def test_each_weakness_has_its_share(
    model: ResponseModel, felt: Felt, answer: Answer, share: float
) -> None:
    said = asked(SimulatedPerson(lambda _: felt, 3, model), times=4_000)
    assert said.count(answer) / len(said) == pytest.approx(share, abs=0.02)


def test_thresholds_rise_by_adaptation_and_are_nearly_there_in_a_quarter_of_an_hour() -> None:
    adapting = SimulatedPerson(
        lambda _: Felt(1.3, 0.1), 3, ResponseModel(noise=0.0, lapses=0.0, adaptation=0.6)
    )
    said = asked(adapting)
    first_missed = said.index("not_felt")
    assert set(said[first_missed:]) == {"not_felt"}
    assert 100 < first_missed < 300
    assert 1.55 < adapting.threshold_times <= 1.6


@pytest.mark.parametrize(("pain_adaptation", "apart"), [(0.0, 1.6), (0.6, 1.0)])
def test_pain_drifts_with_thresholds_and_adapts_by_a_figure_of_its_own(
    pain_adaptation: float, apart: float
) -> None:
    model = ResponseModel(
        noise=0.0, lapses=0.0, drift=0.01, adaptation=0.6, pain_adaptation=pain_adaptation
    )
    felt = [Felt(1.2, 0.1)]
    person = SimulatedPerson(lambda _: felt[0], 3, model)
    asked(person)
    assert 0.97 * apart < person.threshold_times / person.pain_times <= apart
    assert person.pain_times != 1.0
    for part, answer in ((0.99, "not_felt"), (1.01, "too_strong")):
        felt[0] = Felt(0.0, part * model.discomfort * person.pain_times)
        assert asked(person, times=1) == [answer]


def test_thresholds_drift_like_a_walk_by_chance() -> None:
    ends = []
    for seed in range(200):
        person = SimulatedPerson(lambda _: Felt(0.0, 0.0), seed, ResponseModel(drift=0.01))
        asked(person, times=100)
        ends.append(person.threshold_times)
    assert 0.9 < sorted(ends)[100] < 1.1
    assert 50 < sum(abs(end - 1.0) > 0.1 for end in ends) < 90, "a third lies beyond one deviation"


def test_a_second_question_is_about_the_same_presentation() -> None:
    felt = [Felt(2.0, 1.2)]
    person = SimulatedPerson(lambda _: felt[0], 3, SURE)
    assert asked(person, times=1) == ["too_strong"]
    felt[0] = Felt(0.0, 0.0)
    assert asked(person, "sure", 1) == ["too_strong"]
    assert asked(person, times=1) == ["not_felt"]


WEAK, STRONG, HURTING = Felt(1.1, 0.1), Felt(2.0, 0.1), Felt(2.0, 1.2)


def compared(
    electrode: Felt,
    reference: Felt,
    model: ResponseModel = SURE,
    times: int = 1,
    *,
    is_last: bool = False,
    ask: tuple[Ask, ...] = ("compare",),
) -> list[Answer]:
    person = SimulatedPerson(lambda one: (electrode, reference)[one], 3, model)
    return [
        person.answer(Question(one, 0, 1, is_last), lambda: None)
        for _ in range(times)
        for one in ask
    ]


@pytest.mark.parametrize(
    ("electrode", "reference", "which"),
    [
        (HURTING, WEAK, ("second", "first")),
        (WEAK, HURTING, ("first", "second")),
        (HURTING, HURTING, ("both", "both")),
    ],
)
def test_which_of_two_was_too_strong_is_the_one_that_hurts(
    electrode: Felt, reference: Felt, which: tuple[Answer, Answer]
) -> None:
    for is_last in (False, True):
        said = compared(electrode, reference, is_last=is_last, ask=("compare", "which"))
        assert said == ["too_strong", which[is_last]]
    assert compared(WEAK, STRONG, ask=("compare", "which")) == ["weaker", "neither"]


@pytest.mark.parametrize(
    ("electrode", "model", "answer", "share"),
    [
        (STRONG, ResponseModel(noise=0.0, lapses=0.3), "weaker", 0.10),
        (Felt(0.0, 0.0), ResponseModel(noise=0.0, lapses=0.0), "weaker", 1.0),
        (Felt(0.9, 0.0), ResponseModel(noise=0.0, lapses=0.0), "weaker", 1.0),
        (Felt(0.0, 0.0), ResponseModel(noise=0.0, lapses=0.0, false_alarms=0.2), "same", 0.10),
        (Felt(0.0, 0.0), ResponseModel(noise=0.0, lapses=0.0, false_alarms=0.2), "stronger", 0.10),
    ],
)
def test_a_comparison_has_lapses_and_false_alarms(
    electrode: Felt, model: ResponseModel, answer: Answer, share: float
) -> None:
    said = compared(electrode, STRONG, model, 4_000)
    assert said.count(answer) / len(said) == pytest.approx(share, abs=0.02)
    said = compared(electrode, STRONG, model, 4_000, is_last=True)
    turned = {"weaker": "stronger", "stronger": "weaker"}.get(answer, answer)
    assert said.count(turned) / len(said) == pytest.approx(share, abs=0.02)  # type: ignore[arg-type]
