"""What a law gave and what it took, of each body, beside no law: and whether it may.

Owns: the bounds of harm, and what follows of them: a law's exclusions. Must not know: how a figure
is made, how it is shown.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan, nan

from bench.run import Bound
from bench.steady_figures import SteadyFigures
from bench.steady_laws import NONE, OWN, SHIPPED
from etd_body.kinds import BodyKind

#: Of no law's: variation over time, the part not felt, and the scans above pain: so none, where
#: there are none without a law.
MOST_TIMES = 1.2
#: Of no law's variation: what a law by the person's own k leaves at the most, where feeling follows
#: resistance.
HALF, FOLLOWING = 0.5, BodyKind.AREA
#: What a page of ours says to use. None keeps the bounds on every body today.
RECOMMENDED: tuple[str, ...] = ()
#: What must keep the bounds on every body.
BOUND = (*SHIPPED, *RECOMMENDED)


@dataclass(frozen=True)
class Pooled:
    """Several fingers of one body under one law: means, and scans above pain in all. `over_time` is
    of those on which anything is felt; nan where that is none.
    """

    over_time: float
    not_felt: float
    scans_above_pain: int
    mean_felt: float
    #: Of these fingers, how many have no law, since their k is refused.
    refused: int = 0
    #: On how many nothing is felt.
    silent: int = 0

    @classmethod
    def of(cls, fingers: Sequence[SteadyFigures]) -> Pooled:
        count = len(fingers)
        varied = [finger.over_time for finger in fingers if not isnan(finger.over_time)]
        return cls(
            sum(varied) / len(varied) if varied else nan,
            sum(finger.below_threshold for finger in fingers) / count,
            sum(finger.scans_above_pain for finger in fingers),
            sum(finger.mean_felt for finger in fingers) / count,
            sum(finger.is_refused for finger in fingers),
            count - len(varied),
        )


@dataclass(frozen=True)
class Harm:
    """One law on one body, beside no law on the same fingers."""

    body: BodyKind
    law: str
    with_law: Pooled
    plain: Pooled
    fingers: int

    @property
    def variation_times(self) -> float:
        """Without end where a law silences a finger. Where nothing is felt without one either,
        there is no variation that it could be times of: the other two tell.
        """
        if self.with_law.silent > self.plain.silent:
            return inf
        if isnan(self.plain.over_time):
            return 1.0
        return _times(self.with_law.over_time, self.plain.over_time)

    @property
    def not_felt_times(self) -> float:
        return _times(self.with_law.not_felt, self.plain.not_felt)

    @property
    def pain_times(self) -> float:
        """Above pain: without end, where nothing is without a law."""
        return _times(self.with_law.scans_above_pain, self.plain.scans_above_pain)

    @property
    def worst(self) -> float:
        """Of the three."""
        return max(self.variation_times, self.not_felt_times, self.pain_times)

    @property
    def is_out(self) -> bool:
        return self.worst > MOST_TIMES

    def bounds(self) -> list[Bound]:
        of = f"{self.law} on {self.body}"
        return [
            _at_most(f"{of}: variation over time, of no law's", self.variation_times, MOST_TIMES),
            _at_most(f"{of}: not felt, of no law's", self.not_felt_times, MOST_TIMES),
            _at_most(f"{of}: scans above pain, of no law's", self.pain_times, MOST_TIMES),
        ]


def _times(found: float, plain: float) -> float:
    if plain > 0.0:
        return found / plain
    return inf if found > 0.0 else 1.0


def _at_most(what: str, value: float, bound: float) -> Bound:
    return Bound(what, round(value, 3), bound, is_met=value <= bound)


def harms(found: Mapping[tuple[BodyKind, str, int], SteadyFigures]) -> list[Harm]:
    """Of every law and body of which there are fingers with and without the law, worst first.

    `found` by body, law and finger: only fingers that have both count.
    """
    bodies_and_laws = {(body, law) for body, law, _ in found if law != NONE}
    made: list[Harm] = []
    for body, law in bodies_and_laws:
        seeds = sorted(
            seed
            for of_body, of_law, seed in found
            if (of_body, of_law) == (body, law) and (body, NONE, seed) in found
        )
        if seeds:
            with_law = Pooled.of([found[body, law, seed] for seed in seeds])
            plain = Pooled.of([found[body, NONE, seed] for seed in seeds])
            made.append(Harm(body, law, with_law, plain, len(seeds)))
    return sorted(made, key=lambda harm: (-harm.worst, -harm.variation_times, harm.law, harm.body))


@dataclass(frozen=True)
class OfFinger:
    """What a bound of several fingers does not show: one of them alone."""

    seed: int
    harm: Harm


def worst_fingers(found: Mapping[tuple[BodyKind, str, int], SteadyFigures]) -> list[OfFinger]:
    """Of each law the finger, on whichever body, that it is worst for; the worst law first."""
    seeds = sorted({seed for _, _, seed in found})
    each = [
        OfFinger(seed, harm)
        for seed in seeds
        for harm in harms({key: figures for key, figures in found.items() if key[2] == seed})
    ]
    each.sort(key=lambda one: (-one.harm.worst, -one.harm.variation_times))
    by_law: dict[str, OfFinger] = {}
    for one in each:
        by_law.setdefault(one.harm.law, one)
    return list(by_law.values())


def exclusions(made: Iterable[Harm]) -> dict[str, list[BodyKind]]:
    """{law: the bodies that it is out of bounds on}, those with the most first."""
    out: dict[str, list[BodyKind]] = {}
    for harm in made:
        bodies = out.setdefault(harm.law, [])
        if harm.is_out:
            bodies.append(harm.body)
    return dict(sorted(out.items(), key=lambda item: -len(item[1])))


def held(made: Iterable[Harm], laws: Sequence[str] = BOUND) -> list[Bound]:
    """What must hold: the bounds on every body, of each of these laws. What was not played is not
    met.
    """
    by_both = {(harm.law, harm.body): harm for harm in made}
    bounds: list[Bound] = []
    for law in laws:
        for body in BodyKind:
            harm = by_both.get((law, body))
            if harm is None:
                bounds.append(Bound(f"{law} on {body}: not played", 0.0, 0.0, is_met=False))
            else:
                bounds += harm.bounds()
    return bounds


def halved(made: Iterable[Harm], law: str = OWN) -> Bound:
    """By the person's own k, whether it ships or not. One that is refused has halved nothing, and
    one that was not played is not met.
    """
    what = f"{law} on {FOLLOWING}: variation over time, of no law's"
    for harm in made:
        if harm.law == law and harm.body is FOLLOWING:
            return _at_most(what, harm.variation_times, HALF)
    return Bound(f"{what}: not played", 0.0, HALF, is_met=False)
