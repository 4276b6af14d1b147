"""Calibrations of persons who answer badly, on skins on paper: a table of errors and of pain.

Owns: which persons, and the bounds of the default method: threshold errors of at most 10 % (median)
and 20 % (nine of ten), and no presentation above 1.1 times the pain of a person who says *too
strong* before it hurts, at 0.85 of where pain begins [design]. Must not know: how anything of it
works. Skins and persons come from the seeds printed, which nothing was tuned on.

The error is that of the threshold at the moment when it was found: it drifts. An electrode that was
not felt counts with its cap. `equalize` finds no thresholds: it begins with what the default method
found with the same person, and its error is that of the level as strong as the reference's; an
electrode that is weaker at its cap counts with its cap. A sitting whose reference is refused has no
errors. Nor is there a calibration where all together is too strong down to below what is felt: such
sittings are counted. Pain is of what was felt: of the whole array together, and of a reference as
well.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from datetime import date
from math import inf
from pathlib import Path
from statistics import median, quantiles
from typing import Any

CLONE = Path(__file__).parents[2]
sys.path[:0] = [str(CLONE / "daemon"), str(CLONE / "hal"), str(CLONE / "tests")]

from msgspec.structs import replace  # noqa: E402

from calibrate_scenes import ROW  # noqa: E402
from etd.calibrate.answers import Presentation  # noqa: E402
from etd.calibrate.course import Course  # noqa: E402
from etd.calibrate.equal_strength import default_reference  # noqa: E402
from etd.calibrate.person import ResponseModel, SimulatedPerson  # noqa: E402
from etd.calibrate.progress import Progress, finished  # noqa: E402
from etd.protocol.calibration import Calibration, ElectrodeLimits, Method  # noqa: E402
from etd.protocol.errors import Refused  # noqa: E402
from noisy_skin import NoisySkin  # noqa: E402

CAP_UA, ELECTRODES = 4_000, 16
SEEDS = tuple(range(9_001, 9_021))
METHODS: tuple[Method, ...] = ("staircase", "limits", "quest-plus", "equalize")
DEFAULT: Method = "staircase"
MEDIAN, NINE_OF_TEN, PAIN = 0.10, 0.20, 1.1
BAD = ResponseModel(
    lapses=0.05,
    false_alarms=0.15,
    drift=0.01,
    adaptation=0.60,
    pain_adaptation=0.60,
    slips=0.03,
)
PERSONS = {
    "good": ResponseModel(),
    "lapses": ResponseModel(lapses=0.05),
    "false alarms": ResponseModel(false_alarms=0.15),
    "drift": ResponseModel(drift=0.01),
    "adaptation": ResponseModel(adaptation=0.60, pain_adaptation=0.60),
    "pain stays": ResponseModel(adaptation=0.60),
    "slips": ResponseModel(slips=0.03),
    "all": BAD,
    "all, pain stays": dataclasses.replace(BAD, pain_adaptation=0.0),
    "at pain": ResponseModel(discomfort=1.0),
    "at pain, slips": ResponseModel(discomfort=1.0, slips=0.03),
    "at pain, all": dataclasses.replace(BAD, discomfort=1.0),
    "endures": dataclasses.replace(BAD, endures=1.5),
}
#: Who says *too strong* no sooner than it hurts: told, and not judged.
TOO_LATE = ("at pain", "at pain, slips", "at pain, all", "endures")
#: Whose thresholds are too near to pain to be found as near as that: docs/calibration.md says so.
NOT_AS_NEAR = "all, pain stays"
#: How many times stronger all electrodes together are felt than the strongest of them [design].
TOGETHER = 1.15
_DAY = date(2025, 3, 4)


@dataclass
class Sitting:
    """What came of one person."""

    errors: list[float] = field(default_factory=list)
    presentations: int = 0
    false_alarm_rate: float = 0.0
    #: The most pain that any presentation came to; 1 is where it begins for this person then.
    pain: float = 0.0
    left: int = 0
    #: No calibration came of it.
    is_refused: bool = False


class _Person:
    """One person on one skin, for one or two sittings."""

    def __init__(self, person: str, seed: int) -> None:
        self._skin, self._seed, self.sitting = NoisySkin(ELECTRODES, seed), seed, Sitting()
        self._skin.summation = TOGETHER
        self._person = SimulatedPerson(self._skin.sense, seed, PERSONS[person])
        self._true_ua: dict[int, float] = {}

    def sit(self, method: Method, baseline: Calibration | None = None) -> Calibration | None:
        """None: no calibration, since all together was too strong at what is felt. Raises: Refused,
        for a reference that was too strong.
        """
        reference = None if baseline is None else _reference(baseline)
        conditions = replace(
            ROW, method=method, electrodes=ELECTRODES, array="grid-4x4", cap_ua=CAP_UA,
            reference=reference,
        )  # fmt: skip
        progress, sitting = Progress(conditions=conditions, seed=self._seed), self.sitting
        course = Course(
            progress, self._skin, self._person, lambda: _DAY, baseline=baseline,
            on_presented=self._hurt, on_threshold=self._settle,
        )  # fmt: skip
        course.run(range(ELECTRODES))
        found = dict(progress.found)
        course.feel_whole()
        sitting.presentations, sitting.left = progress.presentations, len(course.left)
        sitting.false_alarm_rate = progress.false_alarms / max(progress.catch_trials, 1)
        if baseline is None or reference is None:
            sitting.errors = [self._off(one, limits) for one, limits in found.items()]
        else:
            strong_ua = baseline.electrode[reference].comfortable_ua
            sitting.errors = [
                self._weaker(one, limits, strong_ua / self._skin.threshold_ua[reference])
                for one, limits in found.items()
                if one != reference and limits.felt
            ]
        sitting.is_refused = bool(progress.found) and not progress.level_1_ua
        return None if sitting.is_refused else finished(progress, _DAY, "bench")

    def _settle(self, electrode: int) -> None:
        times = self._person.threshold_times
        self._true_ua[electrode] = self._skin.threshold_ua[electrode] * times

    def _off(self, electrode: int, limits: ElectrodeLimits) -> float:
        return limits.threshold_ua / min(self._true_ua[electrode], CAP_UA) - 1.0

    def _weaker(self, electrode: int, limits: ElectrodeLimits, times: float) -> float:
        """What drifts, drifts for both."""
        as_strong_ua = self._skin.threshold_ua[electrode] * times
        return limits.comfortable_ua / min(as_strong_ua, limits.cap_ua) - 1.0

    def _hurt(self, shown: Presentation) -> None:
        """Before the question: nothing has drifted since."""
        for electrode in (shown.electrode, shown.reference):
            if electrode is not None:
                pain = self._skin.sense(electrode).pain / self._person.pain_times
                self.sitting.pain = max(self.sitting.pain, pain)


def _reference(baseline: Calibration) -> int:
    places = range(ELECTRODES)
    return default_reference(baseline, [one % 4 for one in places], [one // 4 for one in places])


def sit(method: Method, person: str, seed: int) -> Sitting:
    one = _Person(person, seed)
    if method != "equalize":
        one.sit(method)
        return one.sitting
    made = one.sit(DEFAULT)
    try:
        if made is not None:
            one.sit(method, made)
    except Refused:
        one.sitting.is_refused = True
    if one.sitting.is_refused:
        one.sitting.errors, one.sitting.presentations, one.sitting.left = [], 0, ELECTRODES
    return one.sitting


def row_of(method: Method, person: str, sittings: Sequence[Sitting]) -> dict[str, Any]:
    errors = [abs(error) for sitting in sittings for error in sitting.errors] or [inf, inf]
    nine_of_ten = quantiles(errors, n=10)[-1]
    pain = max(sitting.pain for sitting in sittings)
    is_near = median(errors) <= MEDIAN and nine_of_ten <= NINE_OF_TEN
    is_accurate = is_near or method != DEFAULT or person == NOT_AS_NEAR
    return {
        "method": method,
        "person": person,
        "electrodes": len(errors),
        "left": sum(sitting.left for sitting in sittings),
        "refused": sum(sitting.is_refused for sitting in sittings),
        "presentations": round(sum(one.presentations for one in sittings) / len(errors), 1),
        "median": round(median(errors), 4),
        "nine_of_ten": round(nine_of_ten, 4),
        "bias": round(median([error for one in sittings for error in one.errors] or [inf]), 4),
        "false_alarm_rate": round(median(one.false_alarm_rate for one in sittings), 3),
        "pain": round(pain, 3),
        "ok": is_accurate and (person in TOO_LATE or pain <= PAIN),
    }


def line_of(row: dict[str, Any]) -> str:
    verdict = "holds" if row["ok"] else "FAILS"
    if row["ok"] and row["pain"] > PAIN:
        verdict += ", but for pain, which is told and not judged"
    return (
        f"{row['method']:<10}  {row['person']:<15}  off by {row['median']:6.1%} (median)"
        f" {row['nine_of_ten']:6.1%} (nine of ten), bias {row['bias']:+6.1%};"
        f" {row['presentations']:5.1f} presentations an electrode, {row['left']} without a result,"
        f" {row['refused']} sittings without a calibration;"
        f" silence felt {row['false_alarm_rate']:4.0%}; most pain {row['pain']:.2f} of 1: {verdict}"
    )


def main(given: Sequence[str] | None = None) -> int:
    """Exit status 1 if a bound is not held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--method", choices=METHODS, action="append")
    parser.add_argument("--person", choices=PERSONS, action="append")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS, help="of skins and persons")
    parser.add_argument("--processes", type=int, default=2, help="at once")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args(given)
    rows = []
    with ProcessPoolExecutor(args.processes) as pool:
        for method in args.method or METHODS:
            for person in args.person or PERSONS:
                count = len(args.seeds)
                sittings = list(pool.map(sit, [method] * count, [person] * count, args.seeds))
                rows.append(row_of(method, person, sittings))
                if not args.json:
                    print(line_of(rows[-1]), flush=True)
    ok = all(row["ok"] for row in rows)
    if args.json:
        print(json.dumps({"ok": ok, "seeds": list(args.seeds), "rows": rows}))
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
