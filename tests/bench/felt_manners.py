"""Persons that the estimate was not made for: answers of another manner, as it ships.

Owns: which manners are played, and their table. Must not know: how answers are heeded, how a figure
is made.

`daemon/etd/stabilize/offset_estimate.py` supposes that four of five answers are right, that one who
errs says either of the other two, and that *good* is within 20 % of the strength that is wanted;
and the persons of `make bench-felt` answer so. Nothing says that others do. Here each of these is
another one, and nothing is tuned by what comes out.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bench.felt_compared import MOST_TIMES, felt_without, variation_of
from bench.felt_person import Manner
from bench.felt_play import play
from bench.steady_docs import put
from etd_body.kinds import BodyKind

#: Of each finger: a mean is told, and not judged.
PERSONS: Final = 3
BEGIN: Final = "<!-- written by make bench-felt, other persons -->\n"
END: Final = "<!-- so far, other persons -->\n"
#: By how the page calls them; the first is the one that the estimate supposes.
MANNERS: Final = {
    "as supposed": Manner(),
    "errs with *too strong* alone": Manner(errs="too_strong"),
    "errs with *too weak* alone": Manner(errs="too_weak"),
    "says *good* where they err": Manner(errs="good"),
    "right three times of five": Manner(right=0.6),
    "*good* within 10 %": Manner(band=0.1),
    "*good* within 40 %": Manner(band=0.4),
}


@dataclass(frozen=True)
class Finger:
    """The variation over time without answers, and by manner that of each person; of electrodes
    that are felt without.
    """

    plain: float
    said: dict[str, list[float]]


@dataclass(frozen=True)
class OfBody:
    """By manner, in times of the variation without answers: of all persons together, and the worst
    one's.
    """

    body: BodyKind
    times: dict[str, float]
    worst_person: dict[str, float]


def played(
    bodies: Sequence[BodyKind], seeds: Sequence[int], minutes: float, processes: int
) -> list[OfBody]:
    """Each manner on each body, as it ships."""
    with ProcessPoolExecutor(processes) as pool:
        playing = {
            body: [pool.submit(finger, body, seed, minutes) for seed in seeds] for body in bodies
        }
        return [of_body(body, [one.result() for one in playing[body]]) for body in bodies]


def finger(body: BodyKind, seed: int, minutes: float) -> Finger | None:
    """None: nothing is felt without answers, so that there is no variation."""
    plain = play(body, seed, None, minutes)
    electrodes = felt_without(plain)
    if not electrodes:
        return None
    said = {
        name: [
            variation_of(play(body, seed, manner, minutes, number), electrodes)
            for number in range(PERSONS)
        ]
        for name, manner in MANNERS.items()
    }
    return Finger(variation_of(plain, electrodes), said)


def of_body(body: BodyKind, fingers: Sequence[Finger | None]) -> OfBody:
    felt = [one for one in fingers if one is not None]
    plain = float(np.mean([one.plain for one in felt]))
    return OfBody(
        body,
        {name: float(np.mean([one.said[name] for one in felt])) / plain for name in MANNERS},
        {name: max(max(one.said[name]) / one.plain for one in felt) for name in MANNERS},
    )


def table(found: Sequence[OfBody]) -> str:
    """A row to a manner; in brackets the worst person's."""
    head = f"| | {' | '.join(each.body.value for each in found)} |\n|---|{'---|' * len(found)}\n"
    return head + "".join(
        f"| {name} | {' | '.join(_cell(each, name) for each in found)} |\n" for name in MANNERS
    )


def write(page: Path, found: Sequence[OfBody], said: str) -> None:
    """Between its marks. Raises: ValueError, where they are not there."""
    put(page, BEGIN, f"\nAs it ships, persons of other manners; {said}:\n\n{table(found)}\n", END)


def _cell(each: OfBody, name: str) -> str:
    times = f"{each.times[name]:.2f}"
    is_out = each.times[name] > MOST_TIMES
    return f"{f'**{times}**' if is_out else times} ({each.worst_person[name]:.2f})"
