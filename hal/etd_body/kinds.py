"""Bodies that disagree: kinds of skin and feeling by name, each finger of them drawn by a seed.

Owns: which kinds there are, the ranges that a finger's figures are drawn from, and where the ranges
come from. Must not know: boards, files, clocks, the laws that are judged on them.

A law that was made on one body, and is judged on it, shows what was put into both. These bodies
disagree about what nobody has measured: what a change of resistance says of a threshold. Marks:
[paper] Kajimoto, Electro-tactile Display; [abs] only an abstract was read; [design] no source.

    area         threshold follows the area of contact, dry or wet: Watanabe, Futami, Hoshimiya
                 [abs]
    indifferent  it does not depend on resistance: the current enters by the same spot [design]
    sweat        sweat is electrical only: films and ducts beside the way that is felt [design]
    ducts        each active gland is a path of its own (Thomas and Korr 1957 [abs]); these take
                 the current, and the way in narrows while resistance falls [design]
    capacitive   the current through Rp is the smaller part of a pulse [design]
    bent         Rp falls strongly with current (van Boxtel 1977 [abs]), Rs is large; figures
                 [design]
    adapting     use raises thresholds by 60-270 %, see `shifts`: Kaczmarek 2000 [abs]
    soaking      resistance to a quarter within 20 minutes: a wet skin's 10-25 kOhm [design]
    tender       pain from 1.2 times the threshold on: absolute threshold is close to pain on some
                 electrodes (section 4 [paper]); the figure [design]
    summing      a neighbor's subthreshold pulse lowers the threshold by 18-36 %, see `shifts` [abs]

All kinds draw Rs, Rp, bend, Cp and spreads from the same ranges, but where the kind says otherwise.
The ranges are [design] around the figures that `skin` and `nerve` have, and wider than them, so
that no finger has the constants that a law assumes. The same seed is the same finger in every kind
but for what the kind changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import exp, log

import numpy as np

from etd_body.course import LYING, Script
from etd_body.living import LivingBody
from etd_body.nerve import NerveSpread
from etd_body.shifts import UNSHIFTED, FeelingFigures
from etd_body.skin import SkinFigures


class BodyKind(StrEnum):
    """See the module."""

    AREA = "area"
    INDIFFERENT = "indifferent"
    SWEAT = "sweat"
    DUCTS = "ducts"
    CAPACITIVE = "capacitive"
    BENT = "bent"
    ADAPTING = "adapting"
    SOAKING = "soaking"
    TENDER = "tender"
    SUMMING = "summing"


@dataclass(frozen=True, slots=True)
class Span:
    """From `least` to `most`, even in logarithms if both are above 0, otherwise even."""

    least: float
    most: float

    def drawn(self, random: np.random.Generator) -> float:
        if self.least > 0.0:
            return exp(random.uniform(log(self.least), log(self.most)))
        return random.uniform(self.least, self.most)


SERIES_OHM = Span(700.0, 5_000.0)
PARALLEL_OHM = Span(32_000.0, 65_000.0)
CAPACITANCE_NF = Span(0.2, 0.5)
BEND_UA = Span(3_000.0, 20_000.0)
AREA_SIGMA = Span(0.1, 0.4)
DEPTH_SIGMA = Span(0.03, 0.1)
THRESHOLD_SIGMA = Span(0.1, 0.3)
#: Of what the script has of it.
SWEAT_TIMES, SWEAT_TAU_TIMES = Span(0.6, 1.2), Span(0.5, 1.6)

#: Even with the least of both, more than half of a 100 us pulse's charge passes Cp.
CAPACITIVE_PARALLEL_OHM, CAPACITIVE_NF = Span(60_000.0, 120_000.0), Span(1.6, 3.2)
BENT_UA, BENT_SERIES_OHM = Span(400.0, 1_500.0), Span(5_000.0, 12_000.0)
BENT_PARALLEL_OHM = Span(14_000.0, 24_000.0)
DUCTS_BY_SWEAT = Span(-1.0, -0.4)
ADAPTED = Span(0.6, 2.7)
#: The resistance of a middling electrode after 20 minutes is a quarter of a dry one's.
SOAKED, SOAKING_TAU_S = 0.76, Span(200.0, 300.0)
PAIN_TIMES = 1.2
SUMMED = Span(0.18, 0.36)


@dataclass(frozen=True, slots=True)
class BodyFigures:
    """One finger: what a `LivingBody` is made of, beside its places and its seed."""

    kind: BodyKind
    skin: SkinFigures
    spread: NerveSpread
    script: Script
    feeling: FeelingFigures = UNSHIFTED


def drawn(kind: BodyKind, seed: int, *, doing: Script = LYING) -> BodyFigures:
    """The finger of this seed; `doing`: how it presses and peels, and what its sweat is drawn from.

    A pure function of its arguments.
    """
    random = np.random.default_rng([seed, 7])
    skin = SkinFigures(
        series_ohm=SERIES_OHM.drawn(random),
        parallel_ohm=PARALLEL_OHM.drawn(random),
        capacitance_nf=CAPACITANCE_NF.drawn(random),
        bend_ua=BEND_UA.drawn(random),
        area_sigma=AREA_SIGMA.drawn(random),
    )
    spread = NerveSpread(
        depth_sigma=DEPTH_SIGMA.drawn(random), threshold_sigma=THRESHOLD_SIGMA.drawn(random)
    )
    script = replace(
        doing,
        sweat=doing.sweat * SWEAT_TIMES.drawn(random),
        sweat_tau_s=doing.sweat_tau_s * SWEAT_TAU_TIMES.drawn(random),
    )
    return _of_kind(BodyFigures(kind, skin, spread, script), np.random.default_rng([seed, 8]))


def living(
    kind: BodyKind,
    positions_mm: Sequence[tuple[float, float]],
    *,
    leak_ohm: float,
    compliance_v: float,
    seed: int,
    doing: Script = LYING,
) -> LivingBody:
    """A `LivingBody` of this kind, of the finger of this seed."""
    figures = drawn(kind, seed, doing=doing)
    return LivingBody(
        positions_mm,
        leak_ohm=leak_ohm,
        compliance_v=compliance_v,
        seed=seed,
        script=figures.script,
        figures=figures.skin,
        spread=figures.spread,
        feeling=figures.feeling,
    )


def _of_kind(finger: BodyFigures, random: np.random.Generator) -> BodyFigures:
    """What the kind changes of a finger."""
    skin = finger.skin
    match finger.kind:
        case BodyKind.AREA:
            return finger
        case BodyKind.INDIFFERENT:
            skin = replace(skin, way_by_area=0.0, way_by_sweat=0.0)
        case BodyKind.SWEAT:
            skin = replace(skin, way_by_sweat=0.0)
        case BodyKind.DUCTS:
            skin = replace(skin, way_by_area=0.0, way_by_sweat=DUCTS_BY_SWEAT.drawn(random))
        case BodyKind.CAPACITIVE:
            skin = replace(
                skin,
                parallel_ohm=CAPACITIVE_PARALLEL_OHM.drawn(random),
                capacitance_nf=CAPACITIVE_NF.drawn(random),
            )
        case BodyKind.BENT:
            skin = replace(
                skin,
                bend_ua=BENT_UA.drawn(random),
                series_ohm=BENT_SERIES_OHM.drawn(random),
                parallel_ohm=BENT_PARALLEL_OHM.drawn(random),
            )
        case BodyKind.ADAPTING:
            return replace(finger, feeling=FeelingFigures(adapted=ADAPTED.drawn(random)))
        case BodyKind.SOAKING:
            tau_s = SOAKING_TAU_S.drawn(random)
            return replace(finger, script=replace(finger.script, sweat=SOAKED, sweat_tau_s=tau_s))
        case BodyKind.TENDER:
            return replace(finger, spread=replace(finger.spread, pain_times=PAIN_TIMES))
        case BodyKind.SUMMING:
            return replace(finger, feeling=FeelingFigures(summed=SUMMED.drawn(random)))
    return replace(finger, skin=skin)
