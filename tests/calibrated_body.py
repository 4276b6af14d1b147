"""A living body calibrated over the protocol, and how far what was found lies from the truth.

Owns: the whole way (procedures, session, gateway, engine, board, skin, nerves, simulated person),
with time stepped. Must not know: what must come out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

from etd.calibrate.conditions import Conditions, Progress
from etd.calibrate.course import Course
from etd.calibrate.modelled import FeltPresents, ModelledBody
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.stimulator import Stimulator
from etd.calibration import Method
from etd_body.course import STILL, Script
from stepped_daemon import SteppedDaemon, SteppedDisplay

WIDTH_US, CAP_UA = 100, 3_000


@dataclass(slots=True)
class Outcome:
    """`errors`: by electrode, the threshold found over the body's own, less 1. Skin that
    moves wanders; then its own is the median of what it was at each presentation there.
    `unfelt`: where nothing was felt, the body's own threshold over the cap.
    """

    presentations: int = 0
    minutes: float = 0.0
    most_pain: float = 0.0
    errors: dict[int, float] = field(default_factory=dict)
    unfelt: dict[int, float] = field(default_factory=dict)
    wander: dict[int, float] = field(default_factory=dict)
    left: dict[int, str] = field(default_factory=dict)

    @property
    def worst(self) -> float:
        return max(map(abs, self.errors.values()))


def calibrate_body(
    array: str,
    method: Method,
    electrodes: Sequence[int],
    *,
    person_seed: int,
    body_seed: int,
    script: Script = STILL,
) -> Outcome:
    """A fingertip from a seed, which holds still unless told otherwise."""
    outcome = Outcome()
    with SteppedDaemon(array, body_seed, script) as daemon:
        display = SteppedDisplay(daemon, CAP_UA, WIDTH_US)
        display.arm()
        conditions = conditions_of(daemon, method)
        felt = ModelledBody()
        person = SimulatedPerson(felt.sense, person_seed)
        stimulator = Stimulator(display, display, daemon, conditions, person.wants_stop, felt.hear)
        stimulator.open()

        true_ua: dict[int, list[float]] = {}

        def look(electrode: int) -> None:
            now_ua = daemon.body.told_threshold_ua(electrode, WIDTH_US)
            true_ua.setdefault(electrode, []).append(now_ua)

        def compare(progress: Progress) -> None:
            electrode, found = list(progress.found.items())[-1]
            own_ua = median(true_ua[electrode])
            outcome.wander[electrode] = max(true_ua[electrode]) / min(true_ua[electrode]) - 1.0
            if found.felt:
                outcome.errors[electrode] = found.threshold_ua / own_ua - 1.0
            else:
                outcome.unfelt[electrode] = own_ua / CAP_UA

        course = Course(
            Progress(conditions=conditions),
            FeltPresents(stimulator, felt),
            person,
            on_progress=compare,
            on_presented=look,
        )
        begun_ns = daemon.now_ns()
        outcome.presentations = course.run(electrodes).presentations
        outcome.minutes = (daemon.now_ns() - begun_ns) / 60e9
        outcome.most_pain, outcome.left = felt.most_pain, course.left
        display.close()
    return outcome


def conditions_of(daemon: SteppedDaemon, method: Method) -> Conditions:
    array = daemon.loaded.array
    return Conditions(
        participant="fake",
        method=method,
        body_site="fingertip",
        array=array.name,
        electrodes=array.count,
        polarity="anodic",
        width_us=WIDTH_US,
        rate_hz=60.0,
        returns="all",
        pulses=10,
        cap_ua=CAP_UA,
    )
