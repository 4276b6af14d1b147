"""What `etd calibrate --adaptation` would find on a modelled finger: whether answers may raise.

Owns: which stretch of a finger's time it is asked in, and by which person. When it is asked, which
answers count and what they are enough for is the daemon's own. Must not know: what is raised, and
what comes of it.

It is another stretch than the one that is played: a quarter of an hour later, of a touch that has
rested. The person errs as often as in the other one, at other times.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from bench.felt_person import Manner, Person
from bench.felt_play import HEEDED, SCAN_NS, finger_of, scans
from bench.steady_skin import CALIBRATED_S
from etd.calibrate.adaptation import QUESTIONS, USE_S, adaptation_of
from etd.calibrate.answers import Answer
from etd.protocol.adaptation import MeasuredAdaptation
from etd.stabilize import offset_estimate
from etd_body.kinds import BodyKind

_LATER_S = 900.0
#: So that a person who is asked here errs at other times than the same one later.
_OTHERWISE = 10_000
_WORDS: dict[offset_estimate.Answer, Answer] = {
    "too_weak": "weaker",
    "good": "same",
    "too_strong": "stronger",
}


class _Asked:
    """Implements `Factors`: everything as the frame has it, and a question now and then."""

    def __init__(self, person: Person) -> None:
        self._person = person
        self._first: float | None = None
        self.answers: list[Answer] = []

    def of(self, electrode: int, now_ns: int) -> float:
        return 1.0

    def felt(self, times: float, now_ns: int) -> None:
        """`times` is of the last scans."""
        if now_ns < (HEEDED - 1) * SCAN_NS:
            return
        if self._first is None:
            self._first = times
        if now_ns >= (len(self.answers) + 1) * USE_S / QUESTIONS * 1e9:
            first = self._first
            self.answers.append(_WORDS[self._person.says(times / first if first else 1.0)])


@cache
def own_adaptation(kind: BodyKind, seed: int, manner: Manner, number: int) -> MeasuredAdaptation:
    """Of one of a finger's persons."""
    finger = finger_of(kind, seed, USE_S / 60.0, from_s=CALIBRATED_S + _LATER_S)
    asked = _Asked(Person(replace(manner, insists=False), seed, number + _OTHERWISE))
    scans(finger, asked)
    return adaptation_of(asked.answers, USE_S, finger.calibration.date)


def may_raise(kind: BodyKind, seed: int, manner: Manner, number: int) -> bool:
    """Where the body site allows it."""
    found = own_adaptation(kind, seed, manner, number)
    return found.why_not_in(found.date) is None
