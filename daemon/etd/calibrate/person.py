"""A simulated person, for testing procedures.

Owns: the response model. Must not know: currents, how a sensation comes about: `sense` gives the
strength (1: felt half of the time) and pain (1: pain) of the last presentation on an electrode, as
the body behind a fake board does.

The model [design]: the perceived strength is the felt strength with log-normal noise, over what the
person's thresholds have become by drift and adaptation. Pain drifts with them. Its
adaptation is a separate parameter, since no measurement of it is known to us: with 0, as in the
body (`etd_body.shifts`), a current raised against adaptation comes nearer to pain. A lapse is a
random answer, a false alarm feels what is not there, a slip is another key than was meant. It does
not represent any real person.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from math import exp, log

from etd.calibrate.answers import ANSWERS, Answer, Question

#: Adaptation comes within a quarter of an hour of use [abs]: so many presentations, of which it
#: has nearly all at the end.
_QUARTER_HOUR = 1_000
_NEARLY = 3.0


#: Which of two was too strong, by whether the first was, and the second.
_WHICH: dict[tuple[bool, bool], Answer] = {
    (False, False): "neither",
    (True, False): "first",
    (False, True): "second",
    (True, True): "both",
}


@dataclass(frozen=True, slots=True)
class Felt:
    """One presentation as felt: strength and pain, each 1 at its threshold."""

    strength: float
    pain: float


@dataclass(frozen=True, slots=True)
class ResponseModel:
    """How a simulated person answers. Shares are of 1."""

    #: The standard deviation of the logarithm of the perceived strength.
    noise: float = 0.05
    #: The share of presentations answered by chance.
    lapses: float = 0.01
    #: The share of presentations not felt, silent ones included, that are said to be felt; of two,
    #: to be as strong as the other or stronger.
    false_alarms: float = 0.0
    #: The share of answers where another key is pressed than was meant.
    slips: float = 0.0
    #: The standard deviation of what thresholds and pain change by from one presentation to the
    #: next, up or down (logarithm).
    drift: float = 0.0
    #: The share by which thresholds have risen after a quarter of an hour.
    adaptation: float = 0.0
    #: The same of pain.
    pain_adaptation: float = 0.0
    #: Felt strength that is called comfortable.
    comfortable: float = 1.7
    #: Pain from which on it is called too strong.
    discomfort: float = 0.85
    #: Who endures says so only at so many times this pain.
    endures: float = 1.0
    #: Two strengths nearer than this (logarithm) are called the same, one after the other; and with
    #: minutes between them.
    alike: float = 0.06
    alike_later: float = 0.18
    #: The second of two is felt stronger by this (logarithm).
    second: float = 0.0


class SimulatedPerson:
    """Keeps `Answerer`. The same seed answers the same."""

    def __init__(
        self, sense: Callable[[int], Felt], seed: int, model: ResponseModel | None = None
    ) -> None:
        self._sense = sense
        self._model = model or ResponseModel()
        self._random = random.Random(seed)
        self._presentations = 0
        self._drifted = 0.0
        #: The answer to the last presentation, before any slip; and of two which was too strong.
        self._meant: Answer = "not_felt"
        self._which: Answer = "neither"
        #: How strong it was at the first of the questions about use.
        self._at_first: float | None = None

    @property
    def threshold_times(self) -> float:
        """What drift and adaptation have made of thresholds: times those of the body."""
        return self._times(self._model.adaptation)

    @property
    def pain_times(self) -> float:
        """What drift and adaptation have made of pain: times that of the body."""
        return self._times(self._model.pain_adaptation)

    def answer(self, question: Question, _: Callable[[], None]) -> Answer:
        if question.ask == "which":
            return self._pressed(question, self._which)
        if question.ask in ("quality", "place"):
            return self._pressed(question, ANSWERS[question.ask][0])
        if question.ask in ("stopped", "stopped_which", "stopped_whole"):
            # It stops nothing, so the operator did.
            return "neither" if question.ask == "stopped_which" else "felt"
        if question.ask not in ("sure", "sure_in_use"):
            self._meant = self._judged(question)
            self._presentations += 1
            self._drifted += self._random.gauss(0.0, self._model.drift)
        return self._pressed(question, self._meant)

    def wants_stop(self) -> bool:
        return False

    def _times(self, adaptation: float) -> float:
        adapted = 1.0 - exp(-_NEARLY * self._presentations / _QUARTER_HOUR)
        return exp(self._drifted) * (1.0 + adaptation * adapted)

    def _pressed(self, question: Question, meant: Answer) -> Answer:
        """The key for it, or another one of this question."""
        if self._random.random() >= self._model.slips:
            return meant
        return self._random.choice([one for one in ANSWERS[question.ask] if one != meant])

    def _judged(self, question: Question) -> Answer:
        perceived, hurts = self._perceived(question.electrode)
        if question.reference is not None:
            return self._compared(perceived, hurts, question.reference, question)
        if question.ask == "in_use":
            return self._with_first(perceived, hurts)
        if hurts:
            return "too_strong"
        model, chance = self._model, self._random
        if chance.random() < model.lapses:
            return chance.choice(("not_felt", "felt"))
        if perceived < 1.0:
            return "felt" if chance.random() < model.false_alarms else "not_felt"
        return "comfortable" if perceived >= model.comfortable else "felt"

    def _with_first(self, perceived: float, hurts: bool) -> Answer:
        """What was felt minutes ago is remembered as it was."""
        model, chance = self._model, self._random
        if self._at_first is None:
            self._at_first = perceived
        if hurts:
            return "too_strong"
        if chance.random() < model.lapses:
            return chance.choice(("weaker", "same", "stronger"))
        if perceived < 1.0:
            return "weaker"
        apart = log(perceived / self._at_first)
        if abs(apart) < model.alike_later:
            return "same"
        return "stronger" if apart > 0.0 else "weaker"

    def _perceived(self, electrode: int) -> tuple[float, bool]:
        """How strong it was, and whether it was too strong."""
        model, felt = self._model, self._sense(electrode)
        noise = exp(self._random.gauss(0.0, model.noise))
        pain = felt.pain * noise / self.pain_times
        strength = felt.strength * noise / self.threshold_times
        return strength, pain >= model.discomfort * model.endures

    def _compared(
        self, perceived: float, hurts: bool, reference: int, question: Question
    ) -> Answer:
        """The second with the first. What comes second is felt stronger, by `second`."""
        model, chance = self._model, self._random
        other, other_hurts = self._perceived(reference)
        strengths, too_strong = [other, perceived], [other_hurts, hurts]
        if question.is_reference_last:
            strengths, too_strong = strengths[::-1], too_strong[::-1]
        self._which = _WHICH[too_strong[0], too_strong[1]]
        if any(too_strong):
            return "too_strong"
        if chance.random() < model.lapses:
            return chance.choice(("weaker", "same", "stronger"))
        first, second = (one if one >= 1.0 else 0.0 for one in strengths)
        if first <= 0.0 or second <= 0.0:
            if chance.random() < model.false_alarms:
                return chance.choice(("same", "weaker" if first <= 0.0 else "stronger"))
            return "same" if first == second else "weaker" if first > 0.0 else "stronger"
        apart = log(second / first) + model.second
        if abs(apart) < model.alike:
            return "same"
        return "stronger" if apart > 0.0 else "weaker"
