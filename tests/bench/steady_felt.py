"""`make bench-felt`: what it gives and takes that a person says of the strength, on every body.

Owns: which fingers and persons, what is compared, and the bounds of that. What is felt is modelled:
nobody is measured. Exit status 1 where a bound is not met. Must not know: how answers are heeded.

A finger has several persons, who err at other times: of ten answers two are wrong, and which two
they are moves the figure of one person by more than the bound leaves.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import get_args

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import msgspec  # noqa: E402
import numpy as np  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from bench import felt_foresight, felt_laws  # noqa: E402
from bench.felt_person import Manner  # noqa: E402
from bench.felt_play import MINUTES, Played, play  # noqa: E402
from bench.run import Bound  # noqa: E402
from bench.steady_laws import LAWS  # noqa: E402
from etd.stabilize.offset_estimate import Answer  # noqa: E402
from etd_body.kinds import BodyKind  # noqa: E402

#: Fingers that nothing was tuned on; and the one that the tests play, which everybody looks at.
SEEDS, LOOKED_AT = (911, 912, 913, 914), (31,)
PERSONS = 3
#: Of no answers': the variation over time on every body, and where the drift is common to all.
MOST_TIMES, MOST_TIMES_COMMON = 1.05, 0.8
#: The body on which the bound does not hold: the page has the figures, and why.
NOT_HELD = (BodyKind.SOAKING,)
COMMON = (BodyKind.ADAPTING, BodyKind.SOAKING)


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
    persons together.
    """

    body: BodyKind
    said: Figures
    plain: Figures
    worst_times: float

    @property
    def variation_times(self) -> float:
        return self.said.variation / self.plain.variation

    @property
    def bound(self) -> float:
        return MOST_TIMES_COMMON if self.body in COMMON else MOST_TIMES


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
    return _compared(body, said, plain)


def foreseen(body: BodyKind, seeds: Sequence[int], *, heeds: bool, minutes: float) -> Compared:
    """By a course of factors that knows all that is to come, in place of answers."""
    plain = [[play(body, seed, None, minutes)] for seed in seeds]
    known = [[felt_foresight.best(body, seed, heeds=heeds, minutes=minutes)] for seed in seeds]
    return _compared(body, known, plain)


def _compared(
    body: BodyKind, said: Sequence[Sequence[Played]], plain: Sequence[Sequence[Played]]
) -> Compared:
    by_finger = [
        _figures([one]).variation / _figures([other]).variation
        for one, other in zip(said, plain, strict=True)
    ]
    return Compared(body, _figures(said), _figures(plain), max(by_finger))


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


def main() -> int:
    parser = argparse.ArgumentParser(prog="bench-felt", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS), help="the fingers")
    parser.add_argument("--persons", type=int, default=PERSONS, help="of each finger")
    parser.add_argument("--bodies", type=BodyKind, nargs="+", default=list(BodyKind))
    parser.add_argument("--right", type=float, default=Manner.right, help="answers, of all")
    parser.add_argument("--band", type=float, default=Manner.band, help="what is called good")
    parser.add_argument("--errs", choices=get_args(Answer), help="what they say where they err")
    parser.add_argument("--insists", action="store_true", help="says too strong again soon")
    parser.add_argument("--minutes", type=float, default=MINUTES)
    parser.add_argument(
        "--foreseen",
        choices=("free", "heeding"),
        help="nobody answers: the best that is found by who knows all that is to come, and who"
        " heeds each too strong or need not",
    )
    parser.add_argument(
        "--law",
        choices=list(LAWS),
        help="answers together with this law, through the engine: some minutes for each body and"
        " finger, one person each, and no bounds",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object for all figures")
    args = parser.parse_args()
    manner = Manner(args.right, args.band, args.errs, args.insists)
    if args.law is not None:
        _show_with_law(
            (
                felt_laws.with_law(body, args.law, seed, manner, args.minutes)
                for body in args.bodies
                for seed in args.seeds
            ),
            as_json=args.json,
        )
        return 0
    if args.foreseen is None:
        title = f"with answers (without), modelled: {args.persons} persons each"
        found = [
            compared(body, args.seeds, manner, args.minutes, args.persons) for body in args.bodies
        ]
    else:
        title = f"foreseen, {args.foreseen} (without), modelled"
        heeds = args.foreseen == "heeding"
        found = [
            foreseen(body, args.seeds, heeds=heeds, minutes=args.minutes) for body in args.bodies
        ]
    checked = bounds(found)
    if args.json:
        plain = {"bodies": [asdict(each) for each in found]}
        print(msgspec.json.encode(plain | {"bounds": [asdict(each) for each in checked]}).decode())
    else:
        _show(Console(), found, f"{title}: fingers {', '.join(map(str, args.seeds))}")
    return 0 if all(bound.is_met for bound in checked) else 1


def _show_with_law(found: Iterable[felt_laws.WithLaw], *, as_json: bool) -> None:
    """A line for each as it comes."""
    for each in found:
        if as_json:
            print(msgspec.json.encode(each).decode(), flush=True)
            continue
        plain, alone, said = (
            f"{one.over_time:.1%}, not felt {one.below_threshold:.1%},"
            f" {one.scans_above_pain} scans above pain"
            for one in (each.plain, each.alone, each.said)
        )
        off = "not given up" if each.off_min is None else f"given up at {each.off_min:.0f} min"
        print(f"{each.body}, {each.law}, finger {each.seed} (modelled): {off}")
        print(f"  nothing: {plain}")
        print(f"  the law: {alone}")
        print(f"  with answers: {said}", flush=True)


def _show(console: Console, found: Sequence[Compared], title: str) -> None:
    table = Table(title=title)
    for heading in ("", "variation", "times", "worst", "bound", "not felt", "scans above pain"):
        table.add_column(heading, justify="right")
    for heading in ("too strong", "too weak"):
        table.add_column(heading, justify="right")
    for each in found:
        said, plain = each.said, each.plain
        table.add_row(
            each.body.value,
            f"{said.variation:.1%} ({plain.variation:.1%})",
            f"{'[red]' if each.variation_times > each.bound else ''}{each.variation_times:.2f}",
            f"{each.worst_times:.2f}",
            f"{each.bound:g}",
            f"{said.not_felt:.1%} ({plain.not_felt:.1%})",
            f"{said.scans_above_pain:.0f} ({plain.scans_above_pain:.0f})",
            f"{said.too_strong:.0%} ({plain.too_strong:.0%})",
            f"{said.too_weak:.0%} ({plain.too_weak:.0%})",
        )
    console.print(table)


if __name__ == "__main__":
    sys.exit(main())
