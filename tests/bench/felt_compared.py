"""A body with what its persons say, beside itself without: what came of it, and its bound.

Owns: what is compared, and the bounds. Must not know: how answers are heeded, how a drift is split,
how it is shown.

Which bound a body has is measured on its fingers: 0.8 where the drift is common to all electrodes
(`felt_drift`) and the body site lets answers raise, 1.05 everywhere else. Where they may not,
nothing can be made up for that is felt less and less. Whose answers do raise then is measured on
each finger (`felt_adaptation`), by the questions of the daemon's procedure.

A finger has several persons, who err at other times: of ten answers two are wrong, and which two
they are moves the figure of one person by more than the bound leaves. So the bound is one of the
mean over persons, and the worst of them is told beside it.

How much answers give where the drift is common to all differs from finger to finger by 0.11
(standard deviation): twelve fingers do not tell 0.77 from 0.83. Such a body is played again on a
hundred, one person each, and these are judged.

What is hardly ever felt without answers has no variation that others could be times of: the figure
of an electrode that is felt once in ten minutes is 26 times its mean, and is of that one scan. So
the variation is that of the electrodes that are felt in a twentieth of the scans without answers,
with answers of the same ones; fingers without any are counted, and left out of it. Where answers
bring an electrode to nothing, it is infinite.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import chain, product
from math import nan
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from bench import felt_adaptation, felt_drift
from bench.felt_drift import Drift
from bench.felt_person import Manner
from bench.felt_play import MINUTES, Played, finger_of, play
from bench.run import Bound
from etd_body.kinds import BodyKind

#: Of each finger: of whom it is measured whether they feel less in use, which takes most of the
#: time; and in all, as it ships. One who errs three times in a row moves the mean of 36 by 0.02.
PERSONS, SHIPS_PERSONS = 3, 6
#: An electrode that is felt less often without answers has no variation [design].
LEAST_FELT = 0.05
#: Of no answers': the variation over time on every body, and where the drift is common to all.
MOST_TIMES, MOST_TIMES_COMMON = 1.05, 0.8
#: What is not as it ships, in words.
RAISED = ", where answers may raise"


@dataclass(frozen=True)
class Figures:
    """Means of several fingers and persons; scans above pain: of all fingers, for one person.
    `variation`: of the electrodes that are felt without answers.
    """

    variation: float
    not_felt: float
    scans_above_pain: float
    #: The part of the scans that the person would call so.
    too_strong: float
    too_weak: float


@dataclass(frozen=True)
class Compared:
    """Of a body, with answers and without. `may_raise`: as the body site has it; `raisers` of the
    `persons` may, since it was measured that they feel less in use. `worst_times`: of
    the finger with the most, all its persons together; `worst_person_times`: of a single person.
    `drift`: of these fingers, without answers. `unfelt`: on so many of them nothing is felt then.
    """

    body: BodyKind
    may_raise: bool
    said: Figures
    plain: Figures
    worst_times: float
    worst_person_times: float
    drift: Drift
    unfelt: int = 0
    raisers: int = 0
    persons: int = 0
    fingers: int = 0
    #: Of `variation_times`, over fingers; nan where there are not two.
    standard_error: float = nan

    @property
    def variation_times(self) -> float:
        return self.said.variation / self.plain.variation

    @property
    def bound(self) -> float:
        return MOST_TIMES_COMMON if self.drift.is_common and self.may_raise else MOST_TIMES


def compared(
    bodies: Sequence[BodyKind],
    seeds: Sequence[int],
    manner: Manner,
    minutes: float = MINUTES,
    persons: int = PERSONS,
    processes: int = 1,
    ships_persons: int | None = None,
) -> list[Compared]:
    """All of them where answers may not raise, as it ships; then all where they may, with and
    without answers by the levels that the measurement of that left. `ships_persons`: as it ships,
    if there are more. Without `persons` that is all.
    """
    fingers, ways = list(product(bodies, seeds)), (False, True) if persons else (False,)
    in_all = max(persons, ships_persons or 0)
    with ProcessPoolExecutor(processes) as pool:
        drifts = {each: pool.submit(felt_drift.drift, *each, minutes) for each in fingers}
        plain = {
            each: pool.submit(unsaid, *each, manner, minutes, is_measured=persons > 0)
            for each in fingers
        }
        said = {
            each: [
                pool.submit(said_by, *each, manner, minutes, number, is_measured=number < persons)
                for number in range(in_all)
            ]
            for each in fingers
        }
        _wait_for([*drifts.values(), *plain.values(), *chain.from_iterable(said.values())])
    return [
        _beside(
            body,
            may_raise,
            [[one.result() for one in said[body, seed]] for seed in seeds],
            [plain[body, seed].result()[may_raise] for seed in seeds],
            felt_drift.mean_of([drifts[body, seed].result() for seed in seeds]),
        )
        for may_raise, body in product(ways, bodies)
    ]


def _wait_for(played: Sequence[Future[Any]]) -> None:
    """It takes minutes: a bar on the terminal. Raises: what a player raised, as soon as it did."""
    waited = track(
        as_completed(played),
        "players of ten minutes",
        len(played),
        console=Console(stderr=True),
        disable=not sys.stderr.isatty(),
    )
    for each in waited:
        each.result()


def again_where_common(
    found: Sequence[Compared],
    seeds: Sequence[int],
    manner: Manner,
    minutes: float = MINUTES,
    processes: int = 1,
) -> list[Compared]:
    """The same, and in place of bodies whose drift is common to all what they are on these fingers,
    with a person each.
    """
    bodies = [each.body for each in found if each.drift.is_common and each.may_raise]
    many = compared(bodies, seeds, manner, minutes, 1, processes)
    by_body = {(each.body, each.may_raise): each for each in many}
    return [by_body.get((each.body, each.may_raise), each) for each in found]


@dataclass(frozen=True)
class Outcome:
    """Of one person: as it ships, and where the body site lets answers raise. `may_raise`: it was
    measured of them, before, that they feel less in use.
    """

    ships: Played
    #: None: it was not measured.
    raising: Played | None
    may_raise: bool


def unsaid(
    kind: BodyKind, seed: int, manner: Manner, minutes: float, *, is_measured: bool = True
) -> tuple[Played, Played]:
    """A finger's ten minutes without answers: with the levels as calibrated, and as the measurement
    left them.
    """
    plain = play(kind, seed, None, minutes)
    if not is_measured:
        return plain, plain
    levels = felt_adaptation.measured(kind, seed, manner, 0).levels
    if levels == finger_of(kind, seed, minutes).calibration.electrode:
        return plain, plain
    return plain, play(kind, seed, None, minutes, levels=levels)


def said_by(
    kind: BodyKind,
    seed: int,
    manner: Manner,
    minutes: float,
    number: int,
    *,
    is_measured: bool = True,
) -> Outcome:
    """One person's ten minutes."""
    ships = play(kind, seed, manner, minutes, number)
    if not is_measured:
        return Outcome(ships, None, may_raise=False)
    found = felt_adaptation.measured(kind, seed, manner, number)
    calibrated = finger_of(kind, seed, minutes).calibration.electrode
    if found.raises is None and found.levels == calibrated:
        return Outcome(ships, ships, may_raise=False)
    raising = play(*(kind, seed, manner, minutes, number), raises=found.raises, levels=found.levels)
    return Outcome(ships, raising, found.raises is not None)


def _beside(
    body: BodyKind,
    may_raise: bool,
    outcomes: Sequence[Sequence[Outcome]],
    plain: Sequence[Played],
    drift: Drift,
) -> Compared:
    """`outcomes` by finger and person."""
    measured = [[one for one in persons if one.raising is not None] for persons in outcomes]
    said = [
        [one.raising for one in persons if one.raising is not None]
        if may_raise
        else [one.ships for one in persons]
        for persons in outcomes
    ]
    judged = [felt_without(one) for one in plain]
    felt = [number for number, electrodes in enumerate(judged) if electrodes]
    varied = [[variation_of(one, judged[number]) for one in said[number]] for number in felt]
    varied_plain = [variation_of(plain[number], judged[number]) for number in felt]
    of_finger, of_person = _worst_times(varied, varied_plain)
    return Compared(
        body,
        may_raise,
        _figures(said, varied),
        _figures([[one] for one in plain], [[one] for one in varied_plain]),
        of_finger,
        of_person,
        drift,
        len(plain) - len(felt),
        sum(may_raise and one.may_raise for persons in measured for one in persons),
        sum(map(len, said)),
        len(plain),
        standard_error([float(np.mean(persons)) for persons in varied], varied_plain),
    )


def felt_without(plain: Played) -> list[int]:
    """The electrodes whose variation is judged, by place in `Played`."""
    return [place for place, part in enumerate(plain.felt_part) if part >= LEAST_FELT]


def variation_of(one: Played, electrodes: Sequence[int]) -> float:
    """The mean over these."""
    return float(np.mean([one.variation[place] for place in electrodes]))


def _worst_times(said: Sequence[Sequence[float]], plain: Sequence[float]) -> tuple[float, float]:
    """Of a finger's persons together, and of one person; nan where there is no finger."""
    times = [[one / other for one in persons] for persons, other in zip(said, plain, strict=True)]
    worst_of_finger = max((float(np.mean(persons)) for persons in times), default=nan)
    return worst_of_finger, max(map(max, times), default=nan)


def standard_error(said: Sequence[float], plain: Sequence[float]) -> float:
    """Of the mean of these in times of the mean of those, by leaving out each finger in turn
    (jackknife: Efron and Stein, Annals of Statistics 9, 1981); nan where there are not two.
    """
    count = len(said)
    if count < 2:
        return nan
    without = (sum(said) - np.array(said)) / (sum(plain) - np.array(plain))
    return float(np.sqrt((count - 1) * without.var()))


def _figures(fingers: Sequence[Sequence[Played]], varied: Sequence[Sequence[float]]) -> Figures:
    """[finger][person]; `varied`: the variation, where there is one."""
    played = [one for persons in fingers for one in persons]

    def mean(values: Sequence[float]) -> float:
        return float(np.mean(values)) if values else nan

    return Figures(
        variation=mean([one for persons in varied for one in persons]),
        not_felt=mean([one.figures.below_threshold for one in played]),
        scans_above_pain=len(fingers) * mean([one.figures.scans_above_pain for one in played]),
        too_strong=mean([one.too_strong for one in played]),
        too_weak=mean([one.too_weak for one in played]),
    )


def bounds(found: Sequence[Compared]) -> list[Bound]:
    """What must hold of the variation, on every body. Of those of whom none may raise it is as it
    ships, and judged there with more persons.
    """
    return [
        Bound(
            f"{each.body}: variation over time, of nothing said{raising(each)}",
            round(each.variation_times, 3),
            each.bound,
            is_met=each.variation_times <= each.bound,
        )
        for each in found
        if each.raisers or not each.may_raise
    ]


def raising(each: Compared) -> str:
    return RAISED if each.may_raise else ""
