"""Who gets an exponent k: simulated persons with one and without, by the course of a fit.

Owns: the persons, and the printed counts. Must not know: how a k is fitted.

    python tests/bench/fit.py [--persons 200] [--seed 1] [--model poor]

A line says what came of the persons of a model: who got theirs, who got another, who got none.
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import fit_scenes  # noqa: E402

_MODELS = {"adapting": fit_scenes.ADAPTING, "poor": fit_scenes.POOR}


def one(asked: tuple[str, float, int]) -> float | None:
    """The usable k of one person, if he gets any."""
    model, k, seed = asked
    found = fit_scenes.found(k, seed, _MODELS[model])
    return None if found is None or found.why_not is not None else found.k


def main() -> int:
    parser = argparse.ArgumentParser(prog="bench-fit", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--persons", type=int, default=200, help="of each model, with a k")
    parser.add_argument("--seed", type=int, default=1, help="who they are")
    parser.add_argument("--model", choices=_MODELS, action="append", help="how they answer")
    parser.add_argument("--processes", type=int, help="at once; as many as there are processors")
    chosen = parser.parse_args()
    chance = random.Random(chosen.seed)
    true_k = [chance.uniform(0.5, 1.1) for _ in range(chosen.persons)]
    seeds = [chance.randrange(2**31) for _ in range(chosen.persons)]
    with ProcessPoolExecutor(chosen.processes) as pool:
        for model in chosen.model or _MODELS:
            asked = [(model, k, seed) for k, seed in zip(true_k, seeds, strict=True)]
            got = list(pool.map(one, asked))
            none = list(pool.map(one, [(model, 0.0, seed) for seed in seeds]))
            both = zip(got, true_k, strict=True)
            errors = [abs(k - true) / true for k, true in both if k is not None]
            right = sum(error <= 0.25 for error in errors)
            print(
                f"{model}: of {chosen.persons} with k 0.5 to 1.1, {right} get theirs within 25 %"
                f" ({len(errors)} get one, median error {statistics.median(errors):.0%});"
                f" of {chosen.persons} without, {sum(k is not None for k in none)} get one",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
