"""The person that a simulation asks: how chance comes into the answers."""

from __future__ import annotations

from etd.calibrate.answers import Question
from etd.calibrate.person import Felt, SimulatedPerson


def test_a_simulated_person_feels_half_of_what_is_at_the_threshold() -> None:
    person = SimulatedPerson(lambda _: Felt(1.0, 0.1), 3)
    said = [person.answer(Question("strength", 0), lambda: None) for _ in range(1_000)]
    assert 450 < said.count("not_felt") < 550
    hurt = SimulatedPerson(lambda _: Felt(2.0, 1.2), 3)
    assert {hurt.answer(Question("strength", 0), lambda: None) for _ in range(50)} == {"too_strong"}
