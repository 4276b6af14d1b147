"""Ten minutes of a finger whose person says what they feel, played straight to the body.

Owns: the scans, whose factors the currents have, and when the person is asked. Must not know: how
answers are heeded, what is made of what is felt.

The ten minutes begin when the calibration does: the finger has lain for five minutes then, and is
as it was when it was asked. The pulses go straight to the body with the daemon's factors
(`etd.stabilize.said`) and the caps of the calibration: no soft start, no ledger, no law. So ten
minutes take a second or two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from msgspec import structs

from bench import steady_skin
from bench.felt_person import EXPONENT, Manner, Person, times_wanted, wanted_strength
from bench.felt_whole import APART_NS, WholeFinger, felt_whole, pulse
from bench.steady_figures import SteadyFigures, figures, firm_of
from bench.steady_run import Kept
from bench.steady_skin import CALIBRATED_S, Finger
from etd.files.configuration import fake_config
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.stabilize.said import FeltOffsets
from etd_body.kinds import BodyKind
from etd_body.tissue import Floats

ELECTRODES, LEVEL, MINUTES = 8, 0.6, 10.0
#: All electrodes once in so long; a pulse in a second is use, to a body that adapts.
SCAN_NS = 800_000_000
#: What is felt in so many scans is what is answered for.
HEEDED = 6


class Factors(Protocol):
    """On the currents of the frame."""

    def of(self, electrode: int, now_ns: int) -> float:
        """At a pulse that is fired now."""

    def felt(self, times: float, now_ns: int) -> None:
        """After each scan: what was felt lately, in times of what was wanted."""


class Unsaid:
    """Nobody says anything."""

    def of(self, electrode: int, now_ns: int) -> float:
        return 1.0

    def felt(self, times: float, now_ns: int) -> None: ...


@dataclass(frozen=True)
class Raises:
    """Whose answers may raise, and how fast use is felt less by them (`etd.stabilize.said`)."""

    fades_a_minute: float = 0.0


class Said:
    """The daemon's, by the answers of a person."""

    def __init__(self, person: Person, raises: Raises | None) -> None:
        self._person = person
        fades_a_minute = 0.0 if raises is None else raises.fades_a_minute
        self._offsets = FeltOffsets(
            ELECTRODES, may_raise=raises is not None, fades_a_minute=fades_a_minute
        )
        self._next_ns = int(person.again_s("good") * 1e9)

    def of(self, electrode: int, now_ns: int) -> float:
        factor = self._offsets.factor(electrode, now_ns)
        self._offsets.fired(electrode, now_ns)
        return factor

    def felt(self, times: float, now_ns: int) -> None:
        if now_ns < self._next_ns:
            return
        answer = self._person.says(times)
        self._offsets.hear(answer, None, now_ns + SCAN_NS // 2)
        self._next_ns = now_ns + int(self._person.again_s(answer) * 1e9)


@dataclass(frozen=True)
class Played:
    """What came out of one finger. `too_strong`, `too_weak`: the part of the scans that their
    person would call so, without errors. By electrode, while its contact is firm: `variation` over
    time, of its mean (infinite where nothing is felt), and in which part of the scans it is felt.
    """

    figures: SteadyFigures
    too_strong: float
    too_weak: float
    variation: tuple[float, ...]
    felt_part: tuple[float, ...]


def play(
    kind: BodyKind,
    seed: int,
    manner: Manner | None,
    minutes: float = MINUTES,
    number: int = 0,
    *,
    raises: Raises | None = None,
    levels: tuple[ElectrodeLimits, ...] | None = None,
) -> Played:
    """One finger; `manner` None: without answers. `number`: which of its persons. `raises`:
    None: their answers may not. `levels`: in place of those that were calibrated.
    """
    factors: Factors = Unsaid()
    if manner is not None:
        factors = Said(Person(manner, seed, number), raises)
    finger = finger_of(kind, seed, minutes)
    if levels is not None:
        calibration = structs.replace(finger.calibration, electrode=levels)
        finger = replace(finger, calibration=calibration)
    return played_of(finger, factors, "nothing said" if manner is None else "said")


def played_of(finger: WholeFinger, factors: Factors, name: str) -> Played:
    """A finger with these factors on the currents of its frame."""
    kept, times = scans(finger, factors)
    by_right = Person(Manner(), 0)
    judged = [by_right.judges(value) for value in times]
    return Played(
        figures(name, [kept]),
        judged.count("too_strong") / len(judged),
        judged.count("too_weak") / len(judged),
        *_by_electrode(kept),
    )


def _by_electrode(kept: Kept) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Variation, and the part of the scans that is felt."""
    firm = firm_of(kept)
    felt = np.where(firm, kept.felt, np.nan)[:, firm.any(axis=0)]
    mean, is_felt = np.nanmean(felt, axis=0), np.nanmax(felt, axis=0) > 0.0
    varied = np.where(is_felt, np.nanstd(felt, axis=0) / np.where(is_felt, mean, 1.0), np.inf)
    part = np.nansum(felt > 0.0, axis=0) / (~np.isnan(felt)).sum(axis=0)
    return tuple(map(float, varied)), tuple(map(float, part))


def finger_of(kind: BodyKind, seed: int, minutes: float = MINUTES) -> WholeFinger:
    """Calibrated electrode by electrode, and then all together."""
    loaded = fake_config(electrodes=ELECTRODES)
    finger = steady_skin.finger(
        seed, loaded.board, loaded.array, minutes, None, kind, from_s=CALIBRATED_S
    )
    return felt_whole(finger, seed, loaded, kind, frame_ua)


def frame_ua(calibration: Calibration) -> Floats:
    """What the frame asks of each electrode."""
    return np.array(
        [
            (each.threshold_ua + LEVEL * (each.comfortable_ua - each.threshold_ua)) * each.felt
            for each in calibration.electrode
        ]
    )


def wanted_alone(finger: Finger) -> Floats:
    """The strength that each electrode had with that when it was calibrated alone."""
    electrodes = finger.calibration.electrode
    thresholds = np.array([float(each.threshold_ua) for each in electrodes])
    return wanted_strength(frame_ua(finger.calibration), thresholds)


def wanted_of(finger: WholeFinger) -> Floats:
    """The same among its neighbors, as it was accepted."""
    return wanted_alone(finger) * finger.among**EXPONENT


def scans(
    finger: WholeFinger, factors: Factors, looked: Callable[[int], None] = lambda _: None
) -> tuple[Kept, list[float]]:
    """What was felt of each scan, and how strong it was lately for whom it belongs to. `looked`:
    called with the time before each scan.
    """
    currents_ua, wanted = frame_ua(finger.calibration), wanted_of(finger)
    caps_ua = [each.cap_ua for each in finger.calibration.electrode]
    finger.course.begin(0.0)
    felt: list[Floats] = []
    pain: list[Floats] = []
    times_s: list[float] = []
    times: list[float] = []
    for now_ns in range(0, int(finger.pieces.engine_s * 1e9), SCAN_NS):
        looked(now_ns)
        for electrode in map(int, np.flatnonzero(currents_ua)):
            at_ns = now_ns + electrode * APART_NS
            ua = currents_ua[electrode] * factors.of(electrode, at_ns)
            pulse(finger.body, electrode, min(ua, caps_ua[electrode]), at_ns)
        found_felt, found_pain = finger.body.take_felt()
        felt.append(np.array(found_felt))
        pain.append(np.array(found_pain))
        times_s.append(now_ns * 1e-9)
        times.append(times_wanted(np.array(felt[-HEEDED:]), wanted))
        factors.felt(times[-1], now_ns)
    places = [finger.pieces.at(value) for value in times_s]
    counted = [number for number, (_, inside_s) in enumerate(places) if inside_s >= 0.0]
    body_s = [places[number][0] for number in counted]
    kept = Kept(
        felt=np.array(felt)[counted],
        pain=np.array(pain)[counted],
        attached=steady_skin.attached(finger, body_s),
        piece=np.zeros(len(counted)),
        inside_s=np.array([places[number][1] for number in counted]),
        body_s=np.array(body_s),
        counters={},
    )
    return kept, times
