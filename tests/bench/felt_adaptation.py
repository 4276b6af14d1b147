"""What `etd calibrate --adaptation` would find on a modelled finger: whether answers may raise.

Owns: presenting its scans to the body, and the bench's person, who judges by the mean strength of
the last ones. What is shown, when it is asked, which answers count and what they are enough for is
the daemon's own (`etd.calibrate.adaptation`). Must not know: what is raised, and what comes of it.

It is asked on another day: the finger lies, sweats, presses and peels as it does when it is played,
from when it has lain for five minutes on, and its touch has rested. The person errs as often, at
other times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from bench.felt_person import Manner, Person, times_wanted
from bench.felt_play import HEEDED, LEVEL, finger_of
from bench.felt_whole import APART_NS, WholeFinger, pulse
from etd.calibrate.adaptation import (
    QUESTIONS,
    USE_LEVEL,
    USE_S,
    adaptation_of,
    in_use,
)
from etd.calibrate.answers import Answer, Question
from etd.calibrate.stimulator import Delivered
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.calibration import current_of_level
from etd.stabilize import offset_estimate
from etd_body.kinds import BodyKind
from etd_body.tissue import Floats

assert USE_LEVEL == LEVEL, "what is measured is what is played"
#: So that a person who is asked here errs at other times than the same one later.
_OTHERWISE = 10_000
#: A question stands for so long, without use.
_ANSWERED_S = 1.5
_WORDS: dict[offset_estimate.Answer, Answer] = {
    "too_weak": "weaker",
    "good": "same",
    "too_strong": "stronger",
}


class _Used:
    """Implements `Presenter` for all at once: a scan of the body, on its time."""

    def __init__(self, finger: WholeFinger) -> None:
        self._body = finger.body
        self.now_s = 0.0
        #: Of each scan, by electrode.
        self.felt: list[Floats] = []
        finger.course.begin(0.0)

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        begun_ns = int(self.now_s * 1e9)
        for electrode, current_ua in currents_ua.items():
            pulse(self._body, electrode, current_ua, begun_ns + electrode * APART_NS)
        self.felt.append(np.array(self._body.take_felt()[0]))
        self.now_s += self._body.electrode_count * APART_NS * 1e-9
        highest = max(currents_ua, key=currents_ua.__getitem__)
        return Delivered(highest, currents_ua[highest], None, begun_ns)

    def pause(self, seconds: float) -> None:
        self.now_s += seconds

    def keep(self) -> None:
        """No lease lapses here."""

    def present(self, electrode: int, current_ua: int) -> Delivered:
        raise AssertionError("all of them are in use")

    def silence(self, electrode: int) -> Delivered:
        raise AssertionError("all of them are in use")

    def stop(self) -> None:
        raise AssertionError("this person does not stop it")


class _Remembers:
    """Implements `Answerer`: compares the last scans with the first ones."""

    def __init__(self, used: _Used, person: Person) -> None:
        self._used = used
        self._person = person

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        first = np.mean(self._used.felt[:HEEDED], axis=0)
        times = times_wanted(np.array(self._used.felt[-HEEDED:]), first)
        self._used.pause(_ANSWERED_S)
        return _WORDS[self._person.says(times)]

    def wants_stop(self) -> bool:
        return False


@cache
def own_adaptation(kind: BodyKind, seed: int, manner: Manner, number: int) -> MeasuredAdaptation:
    """Of one of a finger's persons."""
    finger = finger_of(kind, seed, (USE_S + QUESTIONS * _ANSWERED_S) / 60.0)
    made, used = finger.calibration, _Used(finger)
    levels = enumerate(made.electrode)
    currents_ua = {
        electrode: current_of_level(limits, USE_LEVEL, made.gamma)
        for electrode, limits in levels
        if limits.felt
    }
    if not currents_ua:
        return adaptation_of(["same"] * QUESTIONS, USE_S, made.date)
    person = Person(replace(manner, insists=False), seed, number + _OTHERWISE)
    answers = in_use(used, _Remembers(used, person), currents_ua, USE_S, lambda: used.now_s)
    return adaptation_of(answers, USE_S, made.date)


def may_raise(kind: BodyKind, seed: int, manner: Manner, number: int) -> bool:
    """Where the body site allows it."""
    found = own_adaptation(kind, seed, manner, number)
    return found.why_not_in(found.date) is None
