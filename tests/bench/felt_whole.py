"""The end of a calibration on a modelled finger: all electrodes once at level 1, as `etd calibrate`
does it, and what is too strong then takes all of them down.

Owns: what presents that to the body, what its person says of it, and how much stronger each
electrode is felt among its neighbors. How far it is taken down is the daemon's own
(`Course.feel_whole`). Must not know: what is played after it.

A person compares with what they accepted: with all electrodes together, each at its level, which
feels stronger than each alone where neighbors add to it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Protocol

import numpy as np
from msgspec.structs import replace

from bench.felt_person import EXPONENT, Manner, Person, times_wanted, wanted_strength
from bench.steady_skin import (
    ASKED_S,
    CALIBRATED_S,
    MOST_CAP_UA,
    WIDTH_US,
    Finger,
    attachment_of,
    body_of,
    conditions_of,
)
from etd.calibrate.answers import Answer, Question
from etd.calibrate.course import Course
from etd.calibrate.progress import Progress
from etd.calibrate.stimulator import Delivered
from etd.calibrate.trial import Unsettled
from etd.files.configuration import LoadedConfig
from etd.protocol.calibration import Calibration
from etd_body.interface import Side, Sides
from etd_body.kinds import BodyKind
from etd_body.living import LivingBody
from etd_body.tissue import Floats

#: From one pulse of a scan to the next, and from one presentation to the next.
APART_NS = 2_000_000
_BETWEEN_S = 1.0
#: The first scan brings neighbors to where they are from then on; the last is what is felt.
_SCANS, _SCAN_S = 2, 0.1
_GRAIN_S = 0.02


@dataclass(frozen=True)
class WholeFinger(Finger):
    """`among`: so many times the current each electrode is felt as among its neighbors."""

    among: Floats


def felt_whole(
    finger: Finger,
    seed: int,
    loaded: LoadedConfig,
    kind: BodyKind,
    frame_of: Callable[[Calibration], Floats],
) -> WholeFinger:
    """The finger with the levels that its person accepts of all together. `frame_of`: what is
    played of a calibration, in uA.
    """
    alone = finger.calibration
    array = _Array(seed, loaded, kind)
    progress = Progress(
        conditions=conditions_of(alone, int(MOST_CAP_UA)),
        found=dict(enumerate(alone.electrode)),
        seed=seed,
    )
    try:
        person = AcceptsWhole(array, level_1_strength(alone))
        Course(progress, array, person, lambda: alone.date).feel_whole()
    except Unsettled:
        # The command ends without a calibration, so nothing is shown.
        progress.found = {one: replace(each, felt=False) for one, each in progress.found.items()}
    accepted = tuple(progress.found[one] for one in range(len(alone.electrode)))
    calibration = replace(alone, electrode=accepted)
    given = {field.name: getattr(finger, field.name) for field in fields(Finger)}
    given["calibration"] = calibration
    return WholeFinger(**given, among=array.among(frame_of(calibration)))


def pulse(body: LivingBody, electrode: int, current_ua: float, at_ns: int) -> None:
    """One against all others, anodic."""
    sides = _sides(body.electrode_count, electrode)
    body.drive(at_ns, current_ua, sides)
    body.drive(at_ns + WIDTH_US * 1_000, 0.0, sides)


@cache
def _sides(count: int, electrode: int) -> Sides:
    """The body keeps what it knows of each by the object."""
    return tuple(Side.SOURCE if other == electrode else Side.GROUND for other in range(count))


class _Array:
    """Implements `Presenter` for all electrodes at once: scans of the body, while all lie on."""

    def __init__(self, seed: int, loaded: LoadedConfig, kind: BodyKind) -> None:
        self._body = body_of(seed, loaded.board, loaded.array, kind)
        self._attachment = attachment_of(seed, loaded.array)
        self._body.look_at(0)
        self._now_s = CALIBRATED_S + loaded.array.count * ASKED_S
        #: Of the last presentation, by electrode.
        self.felt: Floats = np.zeros(loaded.array.count)
        self.pain: Floats = np.zeros(loaded.array.count)

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        ua = np.zeros(self._body.electrode_count)
        for electrode, current_ua in currents_ua.items():
            ua[electrode] = current_ua
        self._scan(ua)
        electrode = int(ua.argmax())
        return Delivered(electrode, currents_ua[electrode], None)

    def among(self, current_ua: Floats) -> Floats:
        """1 where an electrode is not felt."""
        self._scan(current_ua)
        found = np.ones(len(current_ua))
        for electrode in map(int, np.flatnonzero(self.felt > 0.0)):
            alone = self._body.times_threshold(electrode, current_ua[electrode], WIDTH_US)
            found[electrode] = self.felt[electrode] ** (1.0 / EXPONENT) / alone
        return found

    def _scan(self, current_ua: Floats) -> None:
        self._now_s += _BETWEEN_S
        while float(self._attachment.at(self._now_s).area.min()) < 1.0:
            self._now_s += _GRAIN_S
        for number in range(_SCANS):
            self._body.take_felt()
            begun_ns = int((self._now_s + number * _SCAN_S) * 1e9)
            for electrode in map(int, np.flatnonzero(current_ua)):
                at_ns = begun_ns + electrode * APART_NS
                pulse(self._body, electrode, float(current_ua[electrode]), at_ns)
        felt, pain = self._body.take_felt()
        self.felt, self.pain = np.array(felt), np.array(pain)

    def present(self, electrode: int, current_ua: int) -> Delivered:
        raise AssertionError("each electrode has its figures already")

    def silence(self, electrode: int) -> Delivered:
        raise AssertionError("each electrode has its figures already")

    def pause(self, seconds: float) -> None:
        self._now_s += seconds

    def keep(self) -> None:
        """No lease lapses here."""

    def stop(self) -> None:
        raise AssertionError("no presentation is stopped")


class Shown(Protocol):
    """What was felt of the last presentation, and how near to pain it came, by electrode."""

    @property
    def felt(self) -> Floats: ...
    @property
    def pain(self) -> Floats: ...


class AcceptsWhole:
    """Implements `Answerer`: without errors, by the strength that each electrode was accepted with
    and by what hurts.
    """

    def __init__(self, shown: Shown, wanted: Floats) -> None:
        self._shown = shown
        self._person = Person(Manner(right=1.0), 0)
        self._wanted = wanted

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        times = times_wanted(self._shown.felt[None], self._wanted)
        is_hurt = float(self._shown.pain.max()) >= 1.0
        is_too_strong = is_hurt or self._person.judges(times) == "too_strong"
        return "too_strong" if is_too_strong else "felt"

    def wants_stop(self) -> bool:
        return False


def level_1_strength(calibration: Calibration) -> Floats:
    """Of each electrode alone, on the day it was calibrated."""
    electrodes = calibration.electrode
    return wanted_strength(
        np.array([each.comfortable_ua * each.felt for each in electrodes], float),
        np.array([each.threshold_ua for each in electrodes], float),
    )
