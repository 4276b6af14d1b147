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
    summing      a neighbor's pulse below its threshold lowers the next one's by 18-36 %, see
                 `shifts` [abs]; one above does the same [design]

All kinds draw Rs, Rp, bend, Cp and spreads from the same ranges, but where the kind says otherwise.
The ranges (`BodyRanges`, where each can be replaced) are [design] around the figures that `skin`
and `nerve` have, and wider than them, so that hardly a finger has the constants that a law assumes.
The same seed is the same finger in every kind and range but for what these change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import exp, inf, log

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

    def __post_init__(self) -> None:
        """Raises: ValueError."""
        if not -inf < self.least <= self.most < inf:
            raise ValueError(f"a range goes up from one number: {self.least} to {self.most}")

    def drawn(self, random: np.random.Generator) -> float:
        """Always one draw: what another range makes of a seed is untouched by this one."""
        if self.least > 0.0:
            value = exp(random.uniform(log(self.least), log(self.most)))
        else:
            value = random.uniform(self.least, self.most)
        return min(max(value, self.least), self.most)


@dataclass(frozen=True, slots=True)
class BodyRanges:
    """What the figures of a finger are drawn from. Who knows better of one gives that one: `Span`s
    that other sources have, or one value, `Span(x, x)`.
    """

    series_ohm: Span = Span(700.0, 5_000.0)
    parallel_ohm: Span = Span(32_000.0, 65_000.0)
    capacitance_nf: Span = Span(0.2, 0.5)
    bend_ua: Span = Span(3_000.0, 20_000.0)
    area_sigma: Span = Span(0.1, 0.4)
    depth_sigma: Span = Span(0.03, 0.1)
    threshold_sigma: Span = Span(0.1, 0.3)
    #: Of what the script has of it.
    sweat_times: Span = Span(0.6, 1.2)
    sweat_tau_times: Span = Span(0.5, 1.6)
    #: Even with the least of both, more than half of a 100 us pulse's charge passes Cp.
    capacitive_parallel_ohm: Span = Span(60_000.0, 120_000.0)
    capacitive_nf: Span = Span(1.6, 3.2)
    bent_ua: Span = Span(400.0, 1_500.0)
    bent_series_ohm: Span = Span(5_000.0, 12_000.0)
    bent_parallel_ohm: Span = Span(14_000.0, 24_000.0)
    ducts_by_sweat: Span = Span(-1.0, -0.4)
    #: Parts of a threshold at rest that use adds to it.
    adapted: Span = Span(0.6, 2.7)
    #: The resistance of a middling electrode after 20 minutes is a quarter of a dry one's.
    soaked: Span = Span(0.76, 0.76)
    soaking_tau_s: Span = Span(200.0, 300.0)
    #: Pain over touch.
    pain_times: Span = Span(1.2, 1.2)
    summed: Span = Span(0.18, 0.36)


RANGES = BodyRanges()


@dataclass(frozen=True, slots=True)
class BodyFigures:
    """One finger: what a `LivingBody` is made of, beside its places and its seed."""

    kind: BodyKind
    skin: SkinFigures
    spread: NerveSpread
    script: Script
    feeling: FeelingFigures = UNSHIFTED


def drawn(
    kind: BodyKind, seed: int, *, doing: Script = LYING, ranges: BodyRanges = RANGES
) -> BodyFigures:
    """The finger of this seed; `doing`: how it presses and peels, and what its sweat is drawn from.

    A pure function of its arguments.
    """
    random = np.random.default_rng([seed, 7])
    skin = SkinFigures(
        series_ohm=ranges.series_ohm.drawn(random),
        parallel_ohm=ranges.parallel_ohm.drawn(random),
        capacitance_nf=ranges.capacitance_nf.drawn(random),
        bend_ua=ranges.bend_ua.drawn(random),
        area_sigma=ranges.area_sigma.drawn(random),
    )
    spread = NerveSpread(
        depth_sigma=ranges.depth_sigma.drawn(random),
        threshold_sigma=ranges.threshold_sigma.drawn(random),
    )
    script = replace(
        doing,
        sweat=doing.sweat * ranges.sweat_times.drawn(random),
        sweat_tau_s=doing.sweat_tau_s * ranges.sweat_tau_times.drawn(random),
    )
    return _of_kind(
        BodyFigures(kind, skin, spread, script), np.random.default_rng([seed, 8]), ranges
    )


def living(
    kind: BodyKind,
    positions_mm: Sequence[tuple[float, float]],
    *,
    leak_ohm: float,
    compliance_v: float,
    seed: int,
    doing: Script = LYING,
    ranges: BodyRanges = RANGES,
    adapts_faster: float = 1.0,
    body: type[LivingBody] = LivingBody,
) -> LivingBody:
    """A `body` of this kind, of the finger of this seed. `adapts_faster`: where minutes are
    played in seconds, so many times as fast use changes what it feels.
    """
    figures = drawn(kind, seed, doing=doing, ranges=ranges)
    tau_s = figures.feeling.adapting_tau_s / adapts_faster
    return body(
        positions_mm,
        leak_ohm=leak_ohm,
        compliance_v=compliance_v,
        seed=seed,
        script=figures.script,
        figures=figures.skin,
        spread=figures.spread,
        feeling=replace(figures.feeling, adapting_tau_s=tau_s),
    )


def _of_kind(finger: BodyFigures, random: np.random.Generator, ranges: BodyRanges) -> BodyFigures:
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
            skin = replace(skin, way_by_area=0.0, way_by_sweat=ranges.ducts_by_sweat.drawn(random))
        case BodyKind.CAPACITIVE:
            skin = replace(
                skin,
                parallel_ohm=ranges.capacitive_parallel_ohm.drawn(random),
                capacitance_nf=ranges.capacitive_nf.drawn(random),
            )
        case BodyKind.BENT:
            skin = replace(
                skin,
                bend_ua=ranges.bent_ua.drawn(random),
                series_ohm=ranges.bent_series_ohm.drawn(random),
                parallel_ohm=ranges.bent_parallel_ohm.drawn(random),
            )
        case BodyKind.ADAPTING:
            return replace(finger, feeling=FeelingFigures(adapted=ranges.adapted.drawn(random)))
        case BodyKind.SOAKING:
            tau_s = ranges.soaking_tau_s.drawn(random)
            sweat = ranges.soaked.drawn(random)
            return replace(finger, script=replace(finger.script, sweat=sweat, sweat_tau_s=tau_s))
        case BodyKind.TENDER:
            return replace(
                finger, spread=replace(finger.spread, pain_times=ranges.pain_times.drawn(random))
            )
        case BodyKind.SUMMING:
            return replace(finger, feeling=FeelingFigures(summed=ranges.summed.drawn(random)))
    return replace(finger, skin=skin)
