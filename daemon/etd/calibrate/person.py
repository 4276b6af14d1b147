"""A simulated person, for testing procedures.

Owns: the response model. Must not know: currents, how a sensation comes about: `sense` gives the
strength (1: felt half of the time) and pain (1: pain) of the last presentation on an electrode, as
the body behind a fake board does.

The model [design]: the perceived strength is the felt strength with log-normal noise. A lapse is a
random answer. It does not represent any real person.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from math import exp, log

from etd.calibrate.answers import Answer, Question


@dataclass(frozen=True, slots=True)
class Felt:
    """One presentation as felt: strength and pain, each 1 at its threshold."""

    strength: float
    pain: float


@dataclass(frozen=True, slots=True)
class ResponseModel:
    """How a simulated person answers."""

    #: The standard deviation of the logarithm of the perceived strength.
    noise: float = 0.05
    #: The share of presentations answered by chance.
    lapses: float = 0.01
    #: Felt strength that is called comfortable.
    comfortable: float = 1.7
    #: Pain from which on it is called too strong.
    discomfort: float = 0.85
    #: Two strengths nearer than this (logarithm) are called the same.
    alike: float = 0.06


class SimulatedPerson:
    """Keeps `Answerer`. The same seed answers the same."""

    def __init__(
        self, sense: Callable[[int], Felt], seed: int, model: ResponseModel | None = None
    ) -> None:
        self._sense = sense
        self._model = model or ResponseModel()
        self._random = random.Random(seed)

    def answer(self, question: Question, _: Callable[[], None]) -> Answer:
        felt = self._sense(question.electrode)
        if question.ask == "which":
            return "second"  # what it called too strong was the second
        noise = exp(self._random.gauss(0.0, self._model.noise))
        if felt.pain * noise >= self._model.discomfort:
            return "too_strong"
        if question.reference is not None:
            return self._compared(felt.strength * noise, question.reference)
        if self._random.random() < self._model.lapses:
            return self._random.choice(("not_felt", "felt"))
        if felt.strength * noise < 1.0:
            return "not_felt"
        return "comfortable" if felt.strength * noise >= self._model.comfortable else "felt"

    def wants_stop(self) -> bool:
        return False

    def _compared(self, perceived: float, reference: int) -> Answer:
        noise = exp(self._random.gauss(0.0, self._model.noise))
        first = self._sense(reference).strength * noise
        if perceived <= 0.0 or first <= 0.0:
            return "same" if perceived == first else "weaker" if first > 0.0 else "stronger"
        apart = log(perceived / first)
        if abs(apart) < self._model.alike:
            return "same"
        return "stronger" if apart > 0.0 else "weaker"
