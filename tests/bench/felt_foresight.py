"""What answers could reach at best: somebody who knows all that is to come, at the daemon's rates.

Owns: a course of factors over the minutes, common to all electrodes, that falls at once and rises
by at most 5 % a minute and to 1.2; and the search for the one with the least variation over time.
With `heeds`, each minute in which the person rightly says *too strong* takes what the daemon takes,
and nothing rises then: what could be reached by a daemon that does not ignore them.
Must not know: the daemon's estimate.

The search goes by what the body says of each scan (`LivingBody.times_threshold`), and the course
that it finds is then played like any other. It finds a good one and proves none: a better one may
be left. It is random with a fixed seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log

import numpy as np

from bench.felt_known import Known
from bench.felt_person import Manner, Person
from bench.felt_play import ELECTRODES, HEEDED, MINUTES, SCAN_NS, Played, play_with
from etd.stabilize.said import LOWERED_BY, MOST, RISE_A_MINUTE
from etd_body.kinds import BodyKind
from etd_body.tissue import Floats

_MINUTE_NS = 60_000_000_000
_RISE, _MOST, _LOWERED = log(RISE_A_MINUTE), log(MOST), -log(1.0 - LOWERED_BY)
_ROUNDS, _EACH = 60, 24


@dataclass(frozen=True)
class Course:
    """At each answer: how far the logarithm of the factor falls, and the part of 5 % by which it
    rises in the minute that follows. Arrays of [answer], or of [course, answer].
    """

    falls: Floats
    rises: Floats


def best(kind: BodyKind, seed: int, *, heeds: bool, minutes: float = MINUTES) -> Played:
    """The finger, played with the best course that was found."""
    course = _searched(Known(kind, seed, minutes), heeds)
    return play_with(kind, seed, "foreseen", Foreseen(course, heeds), minutes)


class Foreseen:
    """A course as the factors of a finger that is played (`felt_play.Factors`)."""

    def __init__(self, course: Course, heeds: bool) -> None:
        self._course, self._heeds = course, heeds
        self._judge = Person(Manner(), 0)
        self._log, self._rise, self._since_ns, self._answers = 0.0, 0.0, 0, 0

    def of(self, electrode: int, now_ns: int) -> float:
        return exp(self._at(now_ns))

    def _at(self, now_ns: int) -> float:
        risen = self._rise * (now_ns - self._since_ns) / _MINUTE_NS
        return max(self._log, min(_MOST, self._log + risen))

    def felt(self, times: float, now_ns: int) -> None:
        number = self._answers
        if now_ns < (number + 1) * _MINUTE_NS or number == len(self._course.falls):
            return
        fall, rise = float(self._course.falls[number]), _RISE * float(self._course.rises[number])
        if self._heeds and self._judge.judges(times) == "too_strong":
            fall, rise = max(fall, _LOWERED), 0.0
        self._log, self._rise = self._at(now_ns) - fall, rise
        self._since_ns, self._answers = now_ns, number + 1


def _searched(known: Known, heeds: bool) -> Course:
    answers = round(known.minutes) - 1
    random = np.random.default_rng(1)
    begun = _first_courses(answers)
    found = _variations(known, begun, heeds)
    least, variation = _one(begun, int(found.argmin())), float(found.min())
    wide = 0.1
    for _ in range(_ROUNDS):
        near = _near(least, wide, random)
        found = _variations(known, near, heeds)
        if found.min() < variation:
            least, variation = _one(near, int(found.argmin())), float(found.min())
            wide = min(0.2, 1.1 * wide)
        else:
            wide = max(0.01, 0.93 * wide)
    return least


def _one(courses: Course, number: int) -> Course:
    return Course(courses.falls[number], courses.rises[number])


def _first_courses(answers: int) -> Course:
    """A fall at the first answer, then a steady rise, at once or from the fifth answer on."""
    falls, rises = [], []
    for fall in (0.0, 0.1, 0.2, 0.3):
        for rise in (0.0, 0.5, 1.0):
            for from_answer in (0, 4):
                falls.append([fall] + [0.0] * (answers - 1))
                rises.append([rise * (number >= from_answer) for number in range(answers)])
    return Course(np.array(falls), np.array(rises))


def _near(course: Course, wide: float, random: np.random.Generator) -> Course:
    shape = (_EACH, len(course.falls))
    changed = random.random((2, *shape)) < 0.25
    falls = np.maximum(course.falls + changed[0] * random.normal(size=shape) * wide, 0.0)
    rises = course.rises + changed[1] * random.normal(size=shape) * 6.0 * wide
    return Course(np.where(falls < 0.004, 0.0, falls), np.clip(rises, 0.0, 1.0))


def _variations(known: Known, courses: Course, heeds: bool) -> Floats:
    count, answers = courses.falls.shape
    times_ns = np.arange(known.count) * SCAN_NS
    ends = [int(np.searchsorted(times_ns, (n + 1) * _MINUTE_NS)) + 1 for n in range(answers)]
    felt = np.zeros((count, known.count, ELECTRODES))
    reached, rise, begin = np.zeros(count), np.zeros(count), 0
    is_wanted = known.wanted > 0.0
    for number, end in enumerate([*ends, known.count]):
        part = slice(begin, end)
        minutes = (times_ns[part] - times_ns[max(0, begin - 1)]) / _MINUTE_NS
        factors = np.minimum(reached[:, None] + rise[:, None] * minutes, _MOST)
        factors = np.maximum(factors, reached[:, None])
        felt[:, part] = known.felt(factors, part)
        if number == answers:
            break
        lately = felt[:, max(0, end - HEEDED) : end].mean(axis=1)[:, is_wanted]
        times = (lately / known.wanted[is_wanted]).mean(axis=1)
        is_strong = heeds & (times > 1.0 + Manner().band)
        fall = courses.falls[:, number]
        reached = factors[:, -1] - np.where(is_strong, np.maximum(fall, _LOWERED), fall)
        rise = np.where(is_strong, 0.0, _RISE * courses.rises[:, number])
        begin = end
    return known.variations(felt)
