"""A body with what its persons say, beside itself without: what came of it, and its bound.

Owns: what is compared, and the bounds. Must not know: how answers are heeded, how a drift is split,
how it is shown.

Which bound a body has is measured on its fingers: 0.8 where the drift is common to all electrodes
(`felt_drift`) and somebody who knows all beforehand, at the daemon's rates, and heeds each *too
strong*, reaches that (`felt_foresight`); 1.05 everywhere else. Where a drift is common and that is
out of reach, `not_asked` says so.

A finger has several persons, who err at other times: of ten answers two are wrong, and which two
they are moves the figure of one person by more than the bound leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench import felt_drift, felt_foresight
from bench.felt_drift import Drift
from bench.felt_person import Manner
from bench.felt_play import MINUTES, Played, play
from bench.run import Bound
from etd_body.kinds import BodyKind

PERSONS = 3
#: Of no answers': the variation over time on every body, and where the drift is common to all.
MOST_TIMES, MOST_TIMES_COMMON = 1.05, 0.8


@dataclass(frozen=True)
class Figures:
    """Means of several fingers and persons; scans above pain: of all fingers, for one person."""

    variation: float
    not_felt: float
    scans_above_pain: float
    #: The part of the scans that the person would call so.
    too_strong: float
    too_weak: float


@dataclass(frozen=True)
class Compared:
    """Of a body, with answers and without. `worst_times`: of the finger with the most, all its
    persons together. `drift`: of these fingers, without answers. `foreseen_times`: the variation,
    in times of that without answers, that is reached where all is known beforehand, at the daemon's
    rates, and each *too strong* is heeded; None: not asked, as it is no bound.
    """

    body: BodyKind
    said: Figures
    plain: Figures
    worst_times: float
    drift: Drift
    foreseen_times: float | None

    @property
    def variation_times(self) -> float:
        return self.said.variation / self.plain.variation

    @property
    def is_out_of_reach(self) -> bool:
        """Whether nobody could hold the bound of a drift that is common to all."""
        return self.foreseen_times is not None and self.foreseen_times > MOST_TIMES_COMMON

    @property
    def bound(self) -> float:
        is_asked = self.drift.is_common and not self.is_out_of_reach
        return MOST_TIMES_COMMON if is_asked else MOST_TIMES


def compared(
    body: BodyKind,
    seeds: Sequence[int],
    manner: Manner,
    minutes: float = MINUTES,
    persons: int = PERSONS,
) -> Compared:
    plain = [[play(body, seed, None, minutes)] for seed in seeds]
    said = [
        [play(body, seed, manner, minutes, number) for number in range(persons)] for seed in seeds
    ]
    drift = felt_drift.mean_of([felt_drift.drift(body, seed, minutes) for seed in seeds])
    times = None
    if drift.is_common:
        known = [[felt_foresight.best(body, seed, heeds=True, minutes=minutes)] for seed in seeds]
        times = _figures(known).variation / _figures(plain).variation
    return Compared(body, _figures(said), _figures(plain), _worst_times(said, plain), drift, times)


def foreseen(body: BodyKind, seeds: Sequence[int], *, heeds: bool, minutes: float) -> Compared:
    """By a course of factors that knows all that is to come, in place of answers: the bound that
    the drift alone asks for is told beside it, whether it is reached or not.
    """
    plain = [[play(body, seed, None, minutes)] for seed in seeds]
    known = [[felt_foresight.best(body, seed, heeds=heeds, minutes=minutes)] for seed in seeds]
    drift = felt_drift.mean_of([felt_drift.drift(body, seed, minutes) for seed in seeds])
    return Compared(body, _figures(known), _figures(plain), _worst_times(known, plain), drift, None)


def _worst_times(said: Sequence[Sequence[Played]], plain: Sequence[Sequence[Played]]) -> float:
    return max(
        _figures([one]).variation / _figures([other]).variation
        for one, other in zip(said, plain, strict=True)
    )


def _figures(fingers: Sequence[Sequence[Played]]) -> Figures:
    """[finger][person]."""
    played = [one for persons in fingers for one in persons]

    def mean(values: Sequence[float]) -> float:
        return float(np.mean(values))

    return Figures(
        variation=mean([one.figures.over_time for one in played]),
        not_felt=mean([one.figures.below_threshold for one in played]),
        scans_above_pain=len(fingers) * mean([one.figures.scans_above_pain for one in played]),
        too_strong=mean([one.too_strong for one in played]),
        too_weak=mean([one.too_weak for one in played]),
    )


def bounds(found: Sequence[Compared]) -> list[Bound]:
    return [
        Bound(
            f"{each.body}: variation over time, of nothing said",
            round(each.variation_times, 3),
            each.bound,
            is_met=each.variation_times <= each.bound,
        )
        for each in found
    ]


def not_asked(found: Sequence[Compared]) -> list[str]:
    """Where the drift is common to all and its bound is not asked: why."""
    return [
        f"{each.body}: its drift is common to all electrodes ({each.drift.drift:.0%} of the"
        f" variance), and yet {MOST_TIMES_COMMON:g} is not asked of it: who knows all beforehand"
        f" and heeds each too strong, at the daemon's rates, reaches {each.foreseen_times:.2f};"
        f" at any rate {each.drift.left_minutes:.2f}. The bound is that of every body,"
        f" {each.bound:g}."
        for each in found
        if each.drift.is_common and each.is_out_of_reach
    ]
