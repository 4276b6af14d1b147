"""What `etd calibrate --adaptation` would find on a modelled finger: whether answers may raise.

Owns: presenting its scans to the body, and the bench's person, who judges by the mean strength of
the last ones. What is shown, when it is asked, which answers count and what they are enough for is
the daemon's own (`etd.calibrate.adaptation`). Must not know: what is raised, and what comes of it.

It is asked on another day than it is played: the same finger, which sweats, presses and peels at
other times, and whose touch has rested. It lies for five minutes, all together are brought up to
level 1, which may take levels down for good, and then it is in use, as in `etd calibrate
--adaptation`. The person errs as often, at other times, and answers for the mean strength alone.
Asked on the very minutes that are judged, it would earn what these minutes need.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from bench.felt_person import EXPONENT, Manner, Person, times_wanted
from bench.felt_play import ELECTRODES, HEEDED, LEVEL, Raises, finger_of
from bench.felt_whole import APART_NS, AcceptsWhole, level_1_strength, pulse
from bench.steady_skin import MOST_CAP_UA, body_of, conditions_of
from etd.calibrate.adaptation import (
    LIES_PART,
    USE_LEVEL,
    USE_S,
    adaptation_of,
    before_use,
    currents_in_use,
    in_use,
)
from etd.calibrate.answers import Answer, Question
from etd.calibrate.course import Course
from etd.calibrate.stimulator import Delivered
from etd.calibrate.trial import Unsettled
from etd.files.configuration import fake_config
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.calibration import ElectrodeLimits
from etd.stabilize import offset_estimate
from etd.stabilize.said_electrode import fades_a_minute
from etd_body.course import Course as SkinCourse
from etd_body.kinds import BodyKind
from etd_body.living import LivingBody
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

    def __init__(self, body: LivingBody) -> None:
        self._body = body
        self.now_s = 0.0
        #: Of each scan, by electrode.
        self.scans: list[Floats] = []
        self.pain: Floats = np.zeros(body.electrode_count)

    @property
    def felt(self) -> Floats:
        return self.scans[-1]

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        begun_ns = int(self.now_s * 1e9)
        for electrode, current_ua in currents_ua.items():
            pulse(self._body, electrode, current_ua, begun_ns + electrode * APART_NS)
        felt, pain = self._body.take_felt()
        self.scans.append(np.array(felt))
        self.pain = np.array(pain)
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
        self._from = len(used.scans)
        self._person = person

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        first = np.mean(self._used.scans[self._from :][:HEEDED], axis=0)
        times = times_wanted(np.array(self._used.scans[-HEEDED:]), first)
        self._used.pause(_ANSWERED_S)
        return _WORDS[self._person.says(times)]

    def wants_stop(self) -> bool:
        return False


@dataclass(frozen=True)
class Measured:
    """What the command leaves: the levels that were accepted on that day, and what was found; None:
    it would end before.
    """

    levels: tuple[ElectrodeLimits, ...]
    adaptation: MeasuredAdaptation | None

    @property
    def raises(self) -> Raises | None:
        """Where the body site allows it; None: answers may not."""
        found = self.adaptation
        if found is None or found.why_not_in(found.date) is not None:
            return None
        assert found.weaker_from_s is not None, "the daemon's own tells it"
        return Raises(fades_a_minute(found.weaker_from_s))


@cache
def measured(kind: BodyKind, seed: int, manner: Manner, number: int) -> Measured:
    """Of one of a finger's persons; their levels are the same."""
    finger = finger_of(kind, seed)
    calibration = finger.calibration
    used = _Used(another_day(kind, seed))
    used.pause(LIES_PART * USE_S)
    accepted = before_use(conditions_of(calibration, int(MOST_CAP_UA)), calibration)
    whole = AcceptsWhole(used, level_1_strength(calibration) * finger.among**EXPONENT)
    adaptation = None
    try:
        Course(accepted, used, whole, lambda: calibration.date, baseline=calibration).feel_whole()
        currents_ua = currents_in_use(accepted, calibration.gamma)
        if currents_ua and used.felt.any():
            person = Person(replace(manner, insists=False), seed, number + _OTHERWISE)
            remembers = _Remembers(used, person)
            answers = in_use(used, remembers, currents_ua, USE_S, lambda: used.now_s)
            adaptation = adaptation_of(answers, USE_S, calibration.date)
    except Unsettled:
        pass
    levels = tuple(accepted.found[one] for one in range(len(calibration.electrode)))
    return Measured(levels, adaptation)


def another_day(kind: BodyKind, seed: int) -> LivingBody:
    """The same finger, just laid on: what it does from now on is of another seed."""
    loaded = fake_config(electrodes=ELECTRODES)
    body = body_of(seed, loaded.board, loaded.array, kind)
    places = list(zip(loaded.array.x_mm, loaded.array.y_mm, strict=True))
    body.skin.course = SkinCourse(body.skin.course.script, places, seed=seed + _OTHERWISE)
    body.look_at(0)
    return body
