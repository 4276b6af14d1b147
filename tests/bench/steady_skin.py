"""A finger for ten minutes: who it is, what was calibrated of it, and when it is looked at.

Owns: the body of a seed, its calibration, and the seconds that are played of the ten minutes.
Must not know: engines, stabilizers, what is made of it.

Ten minutes of 64 electrodes at 10 Hz are 384000 pulses, each with its own wires: some minutes of a
processor for each law. To look sooner, the body's time can run in pieces: a few seconds around a
peeling, then on to the next one minutes later. Before each piece the skin is held as it is then for
`SETTLING_S`, in which nothing counts. All of it is one long piece.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from etd.calibrate.conditions import Conditions
from etd.files.array import Array
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd_body.course import BUSY, Course, SkinNow
from etd_body.kinds import BodyKind, living
from etd_body.living import LivingBody
from etd_body.tissue import Floats
from etd_body.ways import Ways
from etd_hal.boardfile import BoardFile

WIDTH_US, RATE_HZ = 100, 10.0
SCRIPT = BUSY
SETTLING_S, BEFORE_S, PIECE_S = 0.8, 3.4, 9.6
#: When asking begins, how long it takes for each electrode, and of how many moments of that the
#: answer is the median.
CALIBRATED_S, ASKED_S, _ASKED_TIMES = 300.0, 32.0, 8
#: Where the first piece begins to be looked for: when the finger has lain for a moment.
FIRST_S = 2.0
_GRAIN_S = 0.02
#: A fingertip gets 500 nC a pulse: no cap is higher. Prepulse and probe are part of that, so that
#: no level goes so far.
MOST_CAP_UA, MOST_UA = 5_000.0, 4_500.0
_COMFORTABLE, _COMFORTABLE_BELOW_PAIN, _CAP_BELOW_PAIN = 2.0, 0.75, 0.9


@dataclass(frozen=True)
class Pieces:
    """When each piece begins, in s of the body's time."""

    starts_s: tuple[float, ...]
    piece_s: float = PIECE_S

    @property
    def each_s(self) -> float:
        """How long one takes, settling included."""
        return SETTLING_S + self.piece_s

    @property
    def engine_s(self) -> float:
        """How long they take together."""
        return len(self.starts_s) * self.each_s

    def at(self, elapsed_s: float) -> tuple[float, float]:
        """(the body's time, how far into its piece); negative while the skin is held."""
        number, inside_s = divmod(max(0.0, elapsed_s), self.each_s)
        start_s = self.starts_s[min(int(number), len(self.starts_s) - 1)]
        return start_s + max(0.0, inside_s - SETTLING_S), inside_s - SETTLING_S


class PiecewiseCourse(Course):
    """The same skin, in pieces; until `begin` it is as in the first one's beginning."""

    def __init__(self, whole: Course, pieces: Pieces) -> None:
        self.script = whole.script
        self._whole = whole
        self._pieces = pieces
        self._begun_s: float | None = None

    def begin(self, t_s: float) -> None:
        """From this time on, on the clock of whoever asks."""
        self._begun_s = t_s

    def at(self, t_s: float) -> SkinNow:
        return self._whole.at(self.body_s(t_s))

    def pressure_kpa(self, t_s: float) -> float:
        return self._whole.pressure_kpa(self.body_s(t_s))

    def body_s(self, t_s: float) -> float:
        if self._begun_s is None:
            return self._pieces.starts_s[0]
        return self._pieces.at(t_s - self._begun_s)[0]


@dataclass(frozen=True)
class Finger:
    """A body, its course in pieces, and what is true of its contacts."""

    body: LivingBody
    course: PiecewiseCourse
    pieces: Pieces
    calibration: Calibration
    #: The same peelings on a finger that neither sweats nor presses: `area` is what lies on.
    attachment: Course


def finger(
    seed: int,
    board: BoardFile,
    array: Array,
    minutes: float,
    count: int | None,
    kind: BodyKind | None = None,
    *,
    from_s: float = FIRST_S,
) -> Finger:
    """`count` pieces, spread over the minutes; None is all of them, from `from_s` on. `kind`: None
    is the body that the fake has.

    Between pieces the skin's time runs on and the finger's use does not: it adapts so much faster
    that the pieces have the minutes' adaptation in the end.
    """
    attachment = attachment_of(seed, array)
    calibration = calibrated(seed, board, array, kind)
    lasting_s = minutes * 60.0
    pieces = (
        whole_of(attachment, lasting_s, from_s)
        if count is None
        else pieces_of(attachment, lasting_s, count)
    )
    body = body_of(seed, board, array, kind, faster=lasting_s / pieces.engine_s)
    course = PiecewiseCourse(body.skin.course, pieces)
    body.skin.course = course
    body.skin.refresh(0.0)
    body.look_at(0)
    return Finger(body, course, pieces, calibration, attachment)


def body_of(
    seed: int,
    board: BoardFile,
    array: Array,
    kind: BodyKind | None = None,
    *,
    faster: float = 1.0,
) -> LivingBody:
    """Just laid on. `faster`: so much faster it adapts to use."""
    places = list(zip(array.x_mm, array.y_mm, strict=True))
    leak_ohm, compliance_v = board.source.leak_ohm, board.source.compliance_v
    if kind is None:
        return LivingBody(
            places, leak_ohm=leak_ohm, compliance_v=compliance_v, seed=seed, script=SCRIPT
        )
    return living(
        kind,
        places,
        leak_ohm=leak_ohm,
        compliance_v=compliance_v,
        seed=seed,
        doing=SCRIPT,
        adapts_faster=faster,
    )


def attachment_of(seed: int, array: Array) -> Course:
    """The peelings of a finger that neither sweats nor presses: `area` is what lies on."""
    places = list(zip(array.x_mm, array.y_mm, strict=True))
    return Course(replace(SCRIPT, sweat=0.0, pressing=0.0), places, seed=seed)


def pieces_of(attachment: Course, lasting_s: float, count: int) -> Pieces:
    """One around the first peeling of each part of the time."""
    part_s = (lasting_s - FIRST_S) / count
    starts = (FIRST_S + number * part_s for number in range(count))
    return Pieces(tuple(_peeling_after(attachment, at_s) - BEFORE_S for at_s in starts))


def whole_of(attachment: Course, lasting_s: float, from_s: float) -> Pieces:
    """All of it, from the first peeling after `from_s` on."""
    return Pieces((_peeling_after(attachment, from_s) - BEFORE_S,), lasting_s)


def _peeling_after(attachment: Course, from_s: float) -> float:
    """The next moment at which everything has lain on for a while, and something comes off."""
    lying_s, t_s = 0.0, from_s
    while True:
        if float(attachment.at(t_s).area.min()) >= 1.0:
            lying_s += _GRAIN_S
        elif lying_s >= BEFORE_S:
            return t_s
        else:
            lying_s = 0.0
        t_s += _GRAIN_S


def calibrated(
    seed: int, board: BoardFile, array: Array, kind: BodyKind | None = None
) -> Calibration:
    """What a person with this finger says when it has lain for a while, one electrode after
    another.
    """
    body, attachment = body_of(seed, board, array, kind), attachment_of(seed, array)
    # The body's time begins when it is first looked at.
    body.look_at(0)
    return Calibration(
        participant="modelled",
        body_site="fingertip",
        array=array.name,
        polarity="anodic",
        width_us=WIDTH_US,
        rate_hz=RATE_HZ,
        returns="all",
        date=datetime.date(2025, 1, 15),
        program="bench",
        electrode=tuple(limits_of(body, attachment, electrode) for electrode in range(array.count)),
    )


def limits_of(body: LivingBody, attachment: Course, electrode: int) -> ElectrodeLimits:
    """One electrode's: medians of what is true while it is asked, and lies on. Comfortable is
    twice the threshold, where that stays well below pain and within what anybody gets.
    """
    found: list[tuple[float, float, float]] = []
    for part in range(_ASKED_TIMES):
        at_s = CALIBRATED_S + (electrode + part / _ASKED_TIMES) * ASKED_S
        if attachment.at(at_s).area[electrode] >= 1.0:
            body.look_at(int(at_s * 1e9))
            threshold_ua = min(MOST_UA, body.commanded_threshold_ua(electrode, WIDTH_US))
            pain_ua = body.commanded_pain_threshold_ua(electrode, WIDTH_US)
            ohm = seen_ohm(body, electrode, min(MOST_UA, _COMFORTABLE * threshold_ua))
            found.append((threshold_ua, pain_ua, ohm))
    threshold_ua, pain_ua, ohm = map(median, zip(*found, strict=True))
    comfortable_ua = min(_COMFORTABLE * threshold_ua, _COMFORTABLE_BELOW_PAIN * pain_ua)
    comfortable_ua = min(MOST_UA, max(comfortable_ua, 1.02 * threshold_ua))
    return ElectrodeLimits(
        threshold_ua=round(threshold_ua),
        comfortable_ua=round(comfortable_ua),
        cap_ua=round(min(MOST_CAP_UA, max(comfortable_ua, _CAP_BELOW_PAIN * pain_ua))),
        resistance_ohm=round(ohm),
        felt=threshold_ua < MOST_UA,
    )


def conditions_of(made: Calibration, limit_ua: int) -> Conditions:
    """Of asking this finger again; nothing above `limit_ua` is presented."""
    return Conditions(
        participant=made.participant,
        method="staircase",
        body_site=made.body_site,
        array=made.array,
        electrodes=len(made.electrode),
        polarity=made.polarity,
        width_us=made.width_us,
        rate_hz=made.rate_hz,
        returns=made.returns,
        pulses=5,
        cap_ua=limit_ua,
    )


def seen_ohm(body: LivingBody, electrode: int, commanded_ua: float) -> float:
    """What the end of a long pulse tells, returns and films included."""
    way = Ways(body.skin).against_all(electrode)
    return 1.0 / (1.0 / (body.resistance_ohm(electrode, commanded_ua) + way.rest_ohm) + way.shunt_s)


def attached(finger: Finger, body_s: Sequence[float]) -> Floats:
    """[time, electrode]: what part of each contact lies on."""
    return np.array([finger.attachment.at(value).area for value in body_s])
