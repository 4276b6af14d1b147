"""Calibrations of whole bodies over the protocol, against the bodies' own thresholds: a table.

Owns: which bodies and methods, and the bounds: what is found within a tenth of the body's own, and
no presentation that hurts. Must not know: how anything of it works. Bodies and persons come from
the seeds printed, which nothing was tuned on.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, get_args

CLONE = Path(__file__).parents[2]
sys.path[:0] = [str(CLONE / "daemon"), str(CLONE / "hal"), str(CLONE / "tests")]

from calibrated_body import Outcome, calibrate_body, reference_of  # noqa: E402
from etd.files.configuration import fake_config  # noqa: E402
from etd.protocol.calibration import Method  # noqa: E402
from etd.protocol.errors import FileError, Refused  # noqa: E402
from etd_body.course import LYING, STILL, Script  # noqa: E402

WITHIN = 0.10
SKINS: dict[str, Script] = {"still": STILL, "lying": LYING}
SEEDS = {"still": (101, 102), "lying": (779, 780)}
#: One sitting each, the long ones first. Equal strength needs the thresholds of another method.
SITTINGS: tuple[tuple[Method, ...], ...] = (("limits", "equalize"), ("quest-plus",), ("staircase",))
#: A sitting waits a good deal, for sockets: one more than there are processors to be had.
_AT_ONCE = 3


@dataclass(frozen=True)
class Job:
    """One sitting of one person."""

    array: str
    electrodes: int
    skin: str
    seed: int
    methods: tuple[Method, ...]


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    """Those of the command line. Raises: SystemExit, where they cannot be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--array", default="grid-8x8")
    parser.add_argument("--electrodes", type=int, default=64, help="the first so many")
    parser.add_argument("--seeds", type=int, nargs="+", help="of bodies and persons")
    parser.add_argument("--method", choices=get_args(Method), action="append")
    parser.add_argument(
        "--skin", choices=SKINS, action="append", help="still, or lying: it sweats and moves"
    )
    parser.add_argument("--processes", type=int, default=_AT_ONCE, help="at once")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args(given)
    _check_electrodes(parser, args)
    return args


def main() -> int:
    """Exit status 1 if a bound is not held, or a sitting could not be."""
    args = arguments()
    rows, refused = [], 0
    with ProcessPoolExecutor(args.processes, initializer=_be_quiet) as pool:
        for job, found in zip(jobs(args), pool.map(sit, jobs(args)), strict=True):
            if isinstance(found, str):
                refused += 1
                print(
                    f"{job.skin} {' '.join(job.methods)} seed {job.seed}: {found}", file=sys.stderr
                )
                continue
            rows += [row_of(job, method, outcome) for method, outcome in found.items()]
            if not args.json:
                print("\n".join(map(line_of, rows[-len(found) :])), flush=True)
    ok = refused == 0 and all(row["ok"] for row in rows)
    if args.json:
        print(json.dumps({"ok": ok, "rows": rows}))
    return 0 if ok else 1


def _check_electrodes(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    try:
        array = fake_config(array=args.array).array
    except FileError as error:
        parser.error(str(error))
    if not 1 <= args.electrodes <= array.count:
        parser.error(f"--electrodes {args.electrodes}: {args.array} has 1 to {array.count}")
    reference = reference_of(array)
    if args.electrodes <= reference and "equalize" in (args.method or get_args(Method)):
        parser.error(
            f"equalize compares all others with electrode {reference}, which the first"
            f" {args.electrodes} are without: --electrodes {reference + 1} or more, or another"
            " --method"
        )


def jobs(args: argparse.Namespace) -> Iterator[Job]:
    wanted = set(args.method or get_args(Method))
    for skin in args.skin or SKINS:
        for seed in args.seeds or SEEDS[skin]:
            for methods in SITTINGS:
                last = max(
                    (i for i, method in enumerate(methods, 1) if method in wanted), default=0
                )
                if last:
                    yield Job(args.array, args.electrodes, skin, seed, methods[:last])


def _be_quiet() -> None:
    """What the daemons say of themselves is left out; what goes wrong is raised elsewhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def sit(job: Job) -> dict[Method, Outcome] | str:
    """Or why it could not be: a person who feels nothing, or a reference that was not felt."""
    try:
        return calibrate_body(
            job.array,
            job.methods,
            range(job.electrodes),
            person_seed=job.seed,
            body_seed=job.seed,
            script=SKINS[job.skin],
        )
    except (Refused, FileError) as error:
        return str(error)


def row_of(job: Job, method: Method, found: Outcome) -> dict[str, Any]:
    errors = [*map(abs, found.errors.values())]
    at_cap = {**found.unfelt, **found.weaker}
    return {
        "skin": job.skin,
        "method": method,
        "seed": job.seed,
        "electrodes": len(errors),
        "presentations": found.presentations,
        "minutes": round(found.minutes, 1),
        "median_error": round(median(errors or [0.0]), 4),
        "worst_error": round(found.worst, 4),
        "skin_wandered": round(max(found.wander.values(), default=0.0), 3),
        "unfelt": {electrode: round(part, 3) for electrode, part in found.unfelt.items()},
        "weaker": {electrode: round(part, 3) for electrode, part in found.weaker.items()},
        "most_pain": round(found.most_pain, 3),
        "left": found.left,
        "ok": (
            found.worst <= WITHIN
            and found.most_pain < 1.0
            and not found.left
            and all(part > 1.0 - WITHIN for part in at_cap.values())
        ),
    }


def line_of(row: dict[str, Any]) -> str:
    return (
        f"{row['skin']:<5} {row['method']:<10} seed {row['seed']}: {row['electrodes']} electrodes,"
        f" {row['presentations']} presentations in {row['minutes']} modelled minutes;"
        f" off by {row['median_error']:.1%} (median), {row['worst_error']:.1%} (worst, bound"
        f" {WITHIN:.0%}) while the skin wandered by up to {row['skin_wandered']:.0%};"
        f" at the cap: {len(row['unfelt']) + len(row['weaker'])};"
        f" most pain {row['most_pain']:.2f} of 1: {'holds' if row['ok'] else 'FAILS'}"
    )


if __name__ == "__main__":
    sys.exit(main())
