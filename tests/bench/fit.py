"""Who gets an exponent k: simulated persons with one and without, by the course of a fit.

Owns: the persons, the printed counts, and the bounds: of those with a k of 0.5 and more at least
nine of ten get theirs within 25 %, of those without one at most one of twenty gets one. Must not
know: how a k is fitted.

    python tests/bench/fit.py [--persons 200] [--seed 1] [--model poor]

The first bound is of persons who adapt; of those who answer poorly it is told how many get theirs,
and that hardly anybody gets what he has not holds for them too. Exit status 1 where a bound is not
held.
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import fit_scenes  # noqa: E402

_MODELS = {"adapting": fit_scenes.ADAPTING, "poor": fit_scenes.POOR}
#: Who is held to getting theirs.
_MUST_GET = ("adapting",)
WITHIN, LEAST_RIGHT, MOST_WITHOUT = 0.25, 0.9, 0.05


def one(asked: tuple[str, float, int]) -> float | None:
    """The usable k of one person, if he gets any."""
    model, k, seed = asked
    found = fit_scenes.found(k, seed, _MODELS[model])
    return None if found is None or found.why_not is not None else found.k


def judged(
    model: str,
    true_k: Sequence[float],
    got: Sequence[float | None],
    without: Sequence[float | None],
) -> tuple[str, bool]:
    """What came of the persons of a model, in words, and whether the bounds are held. `got`: by
    those with the `true_k`; `without`: by those who have none.
    """
    both = zip(got, true_k, strict=True)
    errors = [abs(k - true) / true for k, true in both if k is not None]
    right = sum(error <= WITHIN for error in errors)
    wrongly = sum(k is not None for k in without)
    is_right = model not in _MUST_GET or right >= LEAST_RIGHT * len(got)
    is_held = is_right and wrongly <= MOST_WITHOUT * len(without)
    middle = f", median error {statistics.median(errors):.0%}" if errors else ""
    return (
        f"{model}: of {len(got)} with k 0.5 to 1.1, {right} get theirs within {WITHIN:.0%}"
        f" ({len(errors)} get one{middle}); of {len(without)} without, {wrongly} get one:"
        f" {'holds' if is_held else 'FAILS'}"
    ), is_held


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
    is_held = True
    with ProcessPoolExecutor(chosen.processes) as pool:
        for model in chosen.model or _MODELS:
            asked = [(model, k, seed) for k, seed in zip(true_k, seeds, strict=True)]
            got = list(pool.map(one, asked))
            without = list(pool.map(one, [(model, 0.0, seed) for seed in seeds]))
            said, is_model_held = judged(model, true_k, got, without)
            print(said, flush=True)
            is_held = is_held and is_model_held
    return 0 if is_held else 1


if __name__ == "__main__":
    sys.exit(main())
