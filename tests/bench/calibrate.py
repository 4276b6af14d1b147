"""Calibrations of whole bodies over the protocol, against the bodies' own thresholds: a table.

Owns: which bodies and methods, and the bounds: thresholds within a tenth, and no presentation that
hurts. Must not know: how anything of it works. Bodies and persons come from the seeds printed.
The bounds are for skin that holds still: on skin that moves there is no one threshold to find.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

CLONE = Path(__file__).parents[2]
sys.path[:0] = [str(CLONE / "daemon"), str(CLONE / "hal"), str(CLONE / "tests")]

from calibrated_body import Outcome, calibrate_body  # noqa: E402
from etd.calibration import Method  # noqa: E402
from etd_body.course import LYING, STILL, Script  # noqa: E402

METHODS: tuple[Method, ...] = ("limits", "staircase", "quest-plus")
WITHIN = 0.10
SKINS: dict[str, Script] = {"still": STILL, "lying": LYING}


def main() -> int:
    """Exit status 1 if a bound is not held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--array", default="grid-8x8")
    parser.add_argument("--electrodes", type=int, default=64, help="the first so many")
    parser.add_argument("--seeds", type=int, nargs="+", default=[101])
    parser.add_argument("--method", choices=METHODS, action="append")
    parser.add_argument("--skin", choices=SKINS, default="still", help="lying: it sweats and moves")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    rows = []
    for method in args.method or METHODS:
        for seed in args.seeds:
            found = calibrate_body(
                args.array,
                method,
                range(args.electrodes),
                person_seed=seed,
                body_seed=seed,
                script=SKINS[args.skin],
            )
            rows.append(row_of(method, seed, found))
            if not args.json:
                print(line_of(rows[-1]), flush=True)
    if args.json:
        print(json.dumps({"ok": all(row["ok"] for row in rows), "rows": rows}))
    return 0 if all(row["ok"] for row in rows) else 1


def row_of(method: str, seed: int, found: Outcome) -> dict[str, object]:
    errors = sorted(map(abs, found.errors.values()))
    return {
        "method": method,
        "seed": seed,
        "electrodes": len(errors),
        "presentations": found.presentations,
        "minutes": round(found.minutes, 1),
        "median_error": round(errors[len(errors) // 2], 4),
        "worst_error": round(found.worst, 4),
        "skin_wandered": round(max(found.wander.values()), 3),
        "unfelt": {electrode: round(part, 3) for electrode, part in found.unfelt.items()},
        "most_pain": round(found.most_pain, 3),
        "left": found.left,
        "ok": (
            found.worst <= WITHIN
            and found.most_pain < 1.0
            and not found.left
            and all(part > 1.0 - WITHIN for part in found.unfelt.values())
        ),
    }


def line_of(row: dict[str, object]) -> str:
    return (
        f"{row['method']:<11} seed {row['seed']}: {row['electrodes']} electrodes,"
        f" {row['presentations']} presentations in {row['minutes']} modelled minutes; thresholds"
        f" off by {row['median_error']:.1%} (median), {row['worst_error']:.1%} (worst, bound"
        f" {WITHIN:.0%}) while the skin wandered by up to {row['skin_wandered']:.0%}; not felt up"
        f" to the cap: {row['unfelt'] or 'none'}; most pain {row['most_pain']} of 1:"
        f" {'holds' if row['ok'] else 'FAILS'}"
    )


if __name__ == "__main__":
    sys.exit(main())
