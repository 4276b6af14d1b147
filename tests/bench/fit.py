"""Who gets an exponent k: simulated persons with one and without, by the course of a fit.

Owns: the persons, the printed counts, and the bounds that they are held to. Must not know: how a k
is fitted.

    python tests/bench/fit.py [--persons 200] [--seed 1] [--model poor] [--processes 1]
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import fit_scenes  # noqa: E402
from etd.calibrate.person import ResponseModel  # noqa: E402

#: Of those without a k, the most who may get one; of those with one, the least who get theirs.
_MOST_WITHOUT, _LEAST_WITH, _WITHIN = 0.05, 0.9, 0.25
#: Of those who answer poorly fewer get theirs: docs/calibration.md says so, with figures.
_LEAST_POOR = 0.6


class Model(NamedTuple):
    answers: ResponseModel
    least_with: float


_MODELS = {
    "adapting": Model(fit_scenes.ADAPTING, _LEAST_WITH),
    "poor": Model(fit_scenes.POOR, _LEAST_POOR),
}


class Person(NamedTuple):
    model: str
    k: float
    seed: int


def one(person: Person) -> float | None:
    """The usable k of one person, if he gets any."""
    found = fit_scenes.found(person.k, person.seed, _MODELS[person.model].answers)
    return None if found is None or found.why_not is not None else found.k


def main() -> int:
    """1 where a bound is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--persons", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--model", choices=_MODELS, action="append", help="default: each")
    parser.add_argument("--processes", type=int, default=None, help="default: one a processor")
    chosen = parser.parse_args()
    chance = random.Random(chosen.seed)
    true_k = [chance.uniform(0.5, 1.1) for _ in range(chosen.persons)]
    seeds = [chance.randrange(2**31) for _ in range(chosen.persons)]
    is_held = True
    with ProcessPoolExecutor(chosen.processes) as pool:
        for model in chosen.model or _MODELS:
            having = [Person(model, k, seed) for k, seed in zip(true_k, seeds, strict=True)]
            got = list(pool.map(one, having))
            none = list(pool.map(one, [Person(model, 0.0, seed) for seed in seeds]))
            is_held &= _told(model, true_k, got, none)
    return 0 if is_held else 1


def _told(
    model: str, true_k: list[float], got: list[float | None], none: list[float | None]
) -> bool:
    """Whether the bounds hold."""
    both = zip(got, true_k, strict=True)
    errors = [abs(k - true) / true for k, true in both if k is not None]
    right = sum(error <= _WITHIN for error in errors)
    wrongly = sum(k is not None for k in none)
    median = f"median error {statistics.median(errors):.0%}" if errors else "no error"
    persons = len(true_k)
    print(
        f"{model}: of {persons} with k 0.5 to 1.1, {right} get theirs within {_WITHIN:.0%}"
        f" ({len(errors)} get one, {median}); of {persons} without, {wrongly} get one",
        flush=True,
    )
    least, most = _MODELS[model].least_with * persons, _MOST_WITHOUT * persons
    if right >= least and wrongly <= most:
        return True
    print(f"{model}: BROKEN: at least {least:.0f} with and at most {most:.0f} without", flush=True)
    return False


if __name__ == "__main__":
    sys.exit(main())
