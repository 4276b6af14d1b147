"""Who gets an exponent k: simulated persons with one and without, by the course of a fit.

Owns: the persons and fingers, the printed counts, and the bounds: of those with a k of 0.5 and more
at least nine of ten get theirs within 25 %, of those without one at most one of twenty gets one.
Must not know: how a k is fitted.

    python tests/bench/fit.py [--persons 200] [--fingers 60] [--seed 1] [--of poor indifferent]

`adapting`, `pain-stays` and `poor` are persons on a skin of paper, whose thresholds follow its
resistance by the k that is drawn for each, or do not. The others are fingers of these kinds
(`etd_body.kinds`) behind the fake's board, leak included, 8 electrodes each: their k follows from
the body, so it is computed (`true_k`), and the fingers of a kind have one, or none. The first bound
is not of `poor`, nor where touch adapts and pain stays: of those it is told how many get theirs.
Exit status 1 where a bound is not held.
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
from bench import steady_fit_own  # noqa: E402
from etd_body.kinds import BodyKind  # noqa: E402

_MODELS = {
    "adapting": fit_scenes.ADAPTING,
    "pain-stays": fit_scenes.PAIN_STAYS,
    "poor": fit_scenes.POOR,
}
#: Fingers that feel less where they resist less, and those of which the resistance says nothing.
_WITH_K, _WITHOUT = (BodyKind.AREA,), (BodyKind.INDIFFERENT, BodyKind.SWEAT)
_OF = (*_MODELS, *_WITH_K, *_WITHOUT)
_ELECTRODES = 8
#: Who is held to getting theirs.
_MUST_GET = ("adapting", BodyKind.AREA)
WITHIN, LEAST_RIGHT, MOST_WITHOUT = 0.25, 0.9, 0.05


def one(asked: tuple[str, float, int]) -> float | None:
    """The usable k of one person, if he gets any."""
    model, k, seed = asked
    found = fit_scenes.found(k, seed, _MODELS[model])
    return None if found is None or found.why_not is not None else found.k


def finger(asked: tuple[BodyKind, int]) -> tuple[float, float | None]:
    """The true k of one finger, and the usable one that it gets, if any."""
    kind, seed = asked
    found = steady_fit_own.own_fit(kind, seed, _ELECTRODES)
    true = steady_fit_own.true_k(kind, seed, _ELECTRODES, range(_ELECTRODES))
    return true, None if isinstance(found, str) or found.why_not is not None else found.k


def judged(
    model: str,
    true_k: Sequence[float],
    got: Sequence[float | None],
    without: Sequence[float | None],
) -> tuple[str, bool]:
    """What came of the persons of a model, in words, and whether the bounds are held. `got`: by
    those with the `true_k`; `without`: by those who have none.
    """
    said, is_right = [], True
    if got:
        both = zip(got, true_k, strict=True)
        errors = [abs(k - true) / true for k, true in both if k is not None]
        right = sum(error <= WITHIN for error in errors)
        is_right = model not in _MUST_GET or right >= LEAST_RIGHT * len(got)
        middle = f", median error {statistics.median(errors):.0%}" if errors else ""
        said.append(
            f"of {len(got)} with k {min(true_k):.2f} to {max(true_k):.2f}, {right} get theirs"
            f" within {WITHIN:.0%} ({len(errors)} get one{middle})"
        )
    wrongly = sum(k is not None for k in without)
    if without:
        said.append(f"of {len(without)} without, {wrongly} get one")
    is_held = is_right and wrongly <= MOST_WITHOUT * len(without)
    verdict = "holds" if is_held else "FAILS"
    if got and model not in _MUST_GET:
        verdict += ", that they get theirs is told and not asked for"
    return f"{model}: {'; '.join(said)}: {verdict}", is_held


def main() -> int:
    parser = argparse.ArgumentParser(prog="bench-fit", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--persons", type=int, default=200, help="of each model, with a k")
    parser.add_argument("--fingers", type=int, default=60, help="of each kind of body")
    parser.add_argument("--seed", type=int, default=1, help="who they are")
    parser.add_argument(
        "--of",
        choices=_OF,
        nargs="+",
        default=_OF,
        help=f"models and kinds; {' and '.join(_MUST_GET)} alone must get their k, nine of ten",
    )
    parser.add_argument("--processes", type=int, help="at once; as many as there are processors")
    chosen = parser.parse_args()
    chance = random.Random(chosen.seed)
    true_k = [chance.uniform(0.5, 1.1) for _ in range(chosen.persons)]
    seeds = [chance.randrange(2**31) for _ in range(max(chosen.persons, chosen.fingers))]
    is_held = True
    with ProcessPoolExecutor(chosen.processes) as pool:
        for of in chosen.of:
            if of in _MODELS:
                said, is_this_held = _of_persons(pool, of, true_k, seeds[: chosen.persons])
            else:
                said, is_this_held = _of_fingers(pool, BodyKind(of), seeds[: chosen.fingers])
            print(said, flush=True)
            is_held = is_held and is_this_held
    return 0 if is_held else 1


def _of_persons(
    pool: ProcessPoolExecutor, model: str, true_k: Sequence[float], seeds: Sequence[int]
) -> tuple[str, bool]:
    asked = [(model, k, seed) for k, seed in zip(true_k, seeds, strict=True)]
    got = list(pool.map(one, asked))
    without = list(pool.map(one, [(model, 0.0, seed) for seed in seeds]))
    return judged(model, true_k, got, without)


def _of_fingers(
    pool: ProcessPoolExecutor, kind: BodyKind, seeds: Sequence[int]
) -> tuple[str, bool]:
    played = list(pool.map(finger, [(kind, seed) for seed in seeds]))
    got = [k for _, k in played]
    if kind in _WITHOUT:
        return judged(kind, [], [], got)
    return judged(kind, [true for true, _ in played], got, [])


if __name__ == "__main__":
    sys.exit(main())
