"""`make bench-felt`: what it gives and takes that a person says of the strength, on every body.

Owns: a person who answers once a minute and errs, a finger that is played with what follows from
the answers, and the bounds of that. What is felt is modelled: nobody is measured. Exit status 1
where a bound is not met.

The pulses go straight to the body, with the daemon's factors (`etd.stabilize.said`) and the caps of
the calibration: no soft start, no ledger, no law. So ten minutes of a finger take a second or two.
Must not know: how answers are heeded.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import msgspec  # noqa: E402
import numpy as np  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from bench import steady_skin  # noqa: E402
from bench.run import Bound  # noqa: E402
from bench.steady_figures import SteadyFigures, figures  # noqa: E402
from bench.steady_run import Kept  # noqa: E402
from bench.steady_skin import WIDTH_US, Finger  # noqa: E402
from etd.files.configuration import fake_config  # noqa: E402
from etd.stabilize.offset_estimate import Answer  # noqa: E402
from etd.stabilize.said import FeltOffsets  # noqa: E402
from etd_body.interface import Side  # noqa: E402
from etd_body.kinds import BodyKind  # noqa: E402
from etd_body.tissue import Floats  # noqa: E402

ELECTRODES, LEVEL, MINUTES = 8, 0.6, 10.0
#: Fingers that nothing was tuned on; and the one that the tests play, which everybody looks at.
SEEDS, LOOKED_AT = (911, 912), (31,)
#: All electrodes once in so long, 2 ms apart; a pulse in a second is use, to a body that adapts.
_SCAN_NS, _APART_NS = 800_000_000, 2_000_000
_ANSWERS_NS = 60_000_000_000
#: What is felt in so many scans is what is answered for.
_HEEDED = 6
#: Of no answers': the variation over time on every body, and where the drift is common to all.
MOST_TIMES, MOST_TIMES_COMMON = 1.05, 0.8
#: The bodies on which the bound does not hold, on one of these fingers: the page has the figures.
NOT_HELD = (
    BodyKind.INDIFFERENT,
    BodyKind.SWEAT,
    BodyKind.BENT,
    BodyKind.SOAKING,
    BodyKind.SUMMING,
)
COMMON = (BodyKind.ADAPTING, BodyKind.SOAKING)


@dataclass(frozen=True)
class Manner:
    """How somebody answers: `right` so often, and *good* within `band` of what was calibrated."""

    right: float = 0.8
    band: float = 0.2


class Person:
    """Compares what is felt with the strength that was wanted when it was calibrated."""

    def __init__(self, manner: Manner, seed: int) -> None:
        self._manner = manner
        self._random = np.random.default_rng([seed, 11])

    def says(self, times_wanted: float) -> Answer:
        """Once asked, right or not; both wrong answers are as likely."""
        band = 1.0 + self._manner.band
        right: Answer = "good"
        if times_wanted > band:
            right = "too_strong"
        elif times_wanted < 1.0 / band:
            right = "too_weak"
        others: list[Answer] = ["too_weak", "good", "too_strong"]
        others.remove(right)
        return (
            right
            if self._random.random() < self._manner.right
            else others[int(self._random.integers(2))]
        )


def play(
    kind: BodyKind, seed: int, manner: Manner | None, minutes: float = MINUTES
) -> SteadyFigures:
    """One finger; `manner` None: nobody says anything."""
    loaded = fake_config(electrodes=ELECTRODES)
    finger = steady_skin.finger(seed, loaded.board, loaded.array, minutes, None, kind)
    person = None if manner is None else Person(manner, seed)
    name = "nothing said" if manner is None else "said"
    return figures(name, [_kept(finger, person)])


def _kept(finger: Finger, person: Person | None) -> Kept:
    limits = finger.calibration.electrode
    wanted_ua = np.array(
        [
            (each.threshold_ua + LEVEL * (each.comfortable_ua - each.threshold_ua)) * each.felt
            for each in limits
        ]
    )
    wanted = np.array([ua / each.threshold_ua for ua, each in zip(wanted_ua, limits, strict=True)])
    offsets, body, course = FeltOffsets(ELECTRODES), finger.body, finger.course
    course.begin(0.0)
    felt: list[Floats] = []
    pain: list[Floats] = []
    times_s: list[float] = []
    answered_ns = 0
    for now_ns in range(0, int(finger.pieces.engine_s * 1e9), _SCAN_NS):
        for electrode in map(int, np.flatnonzero(wanted_ua)):
            ua = wanted_ua[electrode] * offsets.factor(electrode)
            at_ns = now_ns + electrode * _APART_NS
            offsets.fired(electrode, at_ns)
            _pulse(finger, electrode, min(ua, limits[electrode].cap_ua), at_ns)
        found_felt, found_pain = body.take_felt()
        felt.append(np.array(found_felt))
        pain.append(np.array(found_pain))
        times_s.append(now_ns * 1e-9)
        if person is not None and now_ns - answered_ns >= _ANSWERS_NS:
            answered_ns = now_ns
            lately = np.mean(felt[-_HEEDED:], axis=0)[wanted > 0.0]
            times_wanted = float(np.mean(lately / wanted[wanted > 0.0]))
            offsets.hear(person.says(times_wanted), None, now_ns + _SCAN_NS // 2)
    places = [finger.pieces.at(value) for value in times_s]
    counted = [number for number, (_, inside_s) in enumerate(places) if inside_s >= 0.0]
    body_s = [places[number][0] for number in counted]
    return Kept(
        felt=np.array(felt)[counted],
        pain=np.array(pain)[counted],
        attached=steady_skin.attached(finger, body_s),
        piece=np.zeros(len(counted)),
        inside_s=np.array([places[number][1] for number in counted]),
        body_s=np.array(body_s),
        counters={},
    )


#: By electrode: one against all others, anodic. The body keeps what it knows of each by the object.
_SIDES = tuple(
    tuple(Side.SOURCE if other == electrode else Side.GROUND for other in range(ELECTRODES))
    for electrode in range(ELECTRODES)
)


def _pulse(finger: Finger, electrode: int, current_ua: float, at_ns: int) -> None:
    finger.body.drive(at_ns, current_ua, _SIDES[electrode])
    finger.body.drive(at_ns + WIDTH_US * 1_000, 0.0, _SIDES[electrode])


# --- what came out --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Compared:
    """Of a body, several fingers: means with answers, and without."""

    body: BodyKind
    variation: float
    plain_variation: float
    not_felt: float
    plain_not_felt: float
    scans_above_pain: int
    plain_scans_above_pain: int

    @property
    def variation_times(self) -> float:
        return self.variation / self.plain_variation

    @property
    def bound(self) -> float:
        return MOST_TIMES_COMMON if self.body in COMMON else MOST_TIMES


def compared(
    body: BodyKind, seeds: Sequence[int], manner: Manner, minutes: float = MINUTES
) -> Compared:
    said = [play(body, seed, manner, minutes) for seed in seeds]
    plain = [play(body, seed, None, minutes) for seed in seeds]
    over_time = [float(np.mean([one.over_time for one in each])) for each in (said, plain)]
    below = [float(np.mean([one.below_threshold for one in each])) for each in (said, plain)]
    above_pain = [sum(one.scans_above_pain for one in each) for each in (said, plain)]
    return Compared(
        body,
        over_time[0],
        over_time[1],
        below[0],
        below[1],
        above_pain[0],
        above_pain[1],
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
    parser.add_argument("--right", type=float, default=Manner.right, help="answers, of all")
    parser.add_argument("--band", type=float, default=Manner.band, help="what is called good")
    parser.add_argument("--minutes", type=float, default=MINUTES)
    parser.add_argument("--json", action="store_true", help="one JSON object for all figures")
    args = parser.parse_args()
    manner = Manner(args.right, args.band)
    found = [compared(body, args.seeds, manner, args.minutes) for body in BodyKind]
    checked = bounds(found)
    if args.json:
        plain = {"bodies": [asdict(each) for each in found]}
        print(msgspec.json.encode(plain | {"bounds": [asdict(each) for each in checked]}).decode())
    else:
        _show(Console(), found, args.seeds)
    return 0 if all(bound.is_met for bound in checked) else 1


def _show(console: Console, found: Sequence[Compared], seeds: Sequence[int]) -> None:
    table = Table(title=f"with answers (without), modelled: fingers {', '.join(map(str, seeds))}")
    for heading in ("", "variation", "times", "bound", "not felt", "scans above pain"):
        table.add_column(heading, justify="right")
    for each in found:
        table.add_row(
            each.body.value,
            f"{each.variation:.1%} ({each.plain_variation:.1%})",
            f"{'[red]' if each.variation_times > each.bound else ''}{each.variation_times:.2f}",
            f"{each.bound:g}",
            f"{each.not_felt:.1%} ({each.plain_not_felt:.1%})",
            f"{each.scans_above_pain} ({each.plain_scans_above_pain})",
        )
    console.print(table)


if __name__ == "__main__":
    sys.exit(main())
