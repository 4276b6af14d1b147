"""A living body calibrated over the protocol, and how far what was found lies from the truth.

Owns: the whole way (procedures, session, gateway, engine, board, skin, nerves, simulated person),
with time stepped, and what the truth of each method is. Must not know: what must come out.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from statistics import median

from msgspec.structs import replace

from etd.calibrate.answers import Presentation
from etd.calibrate.conditions import Conditions
from etd.calibrate.course import Course
from etd.calibrate.modelled import FeltPresenter, ModelledBody
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.progress import Progress, finished
from etd.calibrate.stimulator import NotDelivered, Stimulator
from etd.files.array import Array
from etd.protocol.calibration import Calibration, ElectrodeLimits, Method
from etd_body.course import STILL, Script
from stepped_daemon import SteppedDaemon, SteppedDisplay

WIDTH_US, CAP_UA = 100, 3_000
_BASELINE = "first"
_TODAY = datetime.date(2025, 3, 4)


@dataclass(slots=True)
class Outcome:
    """`errors`: by electrode, the current found over the body's own, less 1.

    What is found: the threshold; with `equalize` the level as strong as the reference. The body's
    own: what the source must be told for a pulse at threshold, or for one that is as far above its
    threshold as the reference's is above its own. Skin that moves has another one at each
    presentation (`wander`: the largest over the least, less 1); then it is the median over the
    later half of those that were for it: the earlier half are of the way there.
    `unfelt`, `weaker`: where nothing was felt up to the cap, or it was not as strong as the
    reference: the body's own over the cap, at its largest in those.
    """

    presentations: int = 0
    minutes: float = 0.0
    most_pain: float = 0.0
    errors: dict[int, float] = field(default_factory=dict)
    unfelt: dict[int, float] = field(default_factory=dict)
    weaker: dict[int, float] = field(default_factory=dict)
    wander: dict[int, float] = field(default_factory=dict)
    left: dict[int, str] = field(default_factory=dict)
    made: Calibration | None = None

    @property
    def worst(self) -> float:
        return max(map(abs, self.errors.values()), default=0.0)


def reference_of(array: Array) -> int:
    """The electrode that `equalize` compares all others with."""
    return array.count // 2


def calibrate_body(
    array: str,
    methods: Sequence[Method],
    electrodes: Sequence[int],
    *,
    person_seed: int,
    body_seed: int,
    script: Script = STILL,
    pulses: int = 10,
) -> dict[Method, Outcome]:
    """One sitting: by each method in turn. `equalize` begins with what the one before it found, and
    under its caps. A fingertip from a seed, which holds still unless told otherwise.
    """
    outcomes: dict[Method, Outcome] = {}
    made: Calibration | None = None
    with SteppedDaemon(array, body_seed, script) as daemon:
        for method in methods:
            conditions = conditions_of(daemon, method, pulses)
            baseline = made if method == "equalize" else None
            display = _display(daemon, baseline)
            outcomes[method] = _Sitting(daemon, display, conditions, person_seed, baseline).run(
                electrodes
            )
            made = outcomes[method].made
            display.close()
    return outcomes


def _display(daemon: SteppedDaemon, baseline: Calibration | None) -> SteppedDisplay:
    """Armed. Equal strength goes by the caps of its baseline, as `etd calibrate` has it."""
    if baseline is None:
        display = SteppedDisplay(daemon, CAP_UA, WIDTH_US)
    else:
        display = SteppedDisplay(daemon, calibration=_BASELINE)
        display.set_calibration(_BASELINE, baseline)
    display.arm()
    return display


class _Sitting:
    """One method."""

    def __init__(
        self,
        daemon: SteppedDaemon,
        display: SteppedDisplay,
        conditions: Conditions,
        person_seed: int,
        baseline: Calibration | None,
    ) -> None:
        self._daemon = daemon
        self._felt = felt = ModelledBody()
        self._baseline = baseline
        self._reference = reference_of(daemon.loaded.array)
        self._outcome = Outcome()
        self._true_ua: dict[int, list[float]] = {}
        self._own_ua: dict[int, float] = {}
        self._largest_ua: dict[int, float] = {}
        person = SimulatedPerson(felt.sense, person_seed)
        self._stimulator = Stimulator(
            display, display, daemon, conditions, person.wants_stop, felt.hear
        )
        self._progress = Progress(
            conditions=replace(conditions, reference=self._reference), seed=person_seed
        )
        self._course = Course(
            self._progress,
            FeltPresenter(self._stimulator, felt),
            person,
            lambda: _TODAY,
            baseline=baseline,
            on_presented=self._look,
            on_threshold=self._settle,
            on_found=self._compare,
        )

    def run(self, electrodes: Sequence[int]) -> Outcome:
        outcome, daemon = self._outcome, self._daemon
        self._stimulator.open()
        begun_ns = daemon.now_ns()
        progress = self._course.run(electrodes)
        with suppress(NotDelivered):  # a limit of the array, or a contact that has opened
            self._course.feel_whole()
        outcome.presentations = progress.presentations
        outcome.minutes = (daemon.now_ns() - begun_ns) / 60e9
        outcome.most_pain, outcome.left = self._felt.most_pain, self._course.left
        outcome.made = finished(progress, _TODAY, "test")
        return outcome

    # --- the truth ---------------------------------------------------------------------------

    def _look(self, presented: Presentation) -> None:
        electrode = presented.electrode
        body, times = self._daemon.body, 1.0
        if self._baseline is not None:
            strong_ua = self._baseline.electrode[self._reference].comfortable_ua
            times = body.times_threshold(self._reference, strong_ua, WIDTH_US)
        now_ua = body.commanded_threshold_ua(electrode, WIDTH_US, times=times)
        self._true_ua.setdefault(electrode, []).append(now_ua)

    def _settle(self, electrode: int) -> None:
        true_ua = self._true_ua.pop(electrode)
        later_ua = true_ua[len(true_ua) // 2 :]
        self._own_ua[electrode], self._largest_ua[electrode] = median(later_ua), max(later_ua)
        self._outcome.wander[electrode] = max(true_ua) / min(true_ua) - 1.0

    def _compare(self, electrode: int) -> None:
        found = self._progress.found[electrode]
        if self._baseline is None:
            self._compare_threshold(electrode, found)
        elif electrode != self._reference and found.felt:
            self._settle(electrode)
            self._compare_strength(electrode, found)

    def _compare_threshold(self, electrode: int, found: ElectrodeLimits) -> None:
        own_ua = self._own_ua[electrode]
        if found.felt:
            self._outcome.errors[electrode] = found.threshold_ua / own_ua - 1.0
        else:
            self._outcome.unfelt[electrode] = self._largest_ua[electrode] / CAP_UA

    def _compare_strength(self, electrode: int, found: ElectrodeLimits) -> None:
        own_ua = self._own_ua[electrode]
        if found.comfortable_ua < found.cap_ua:
            self._outcome.errors[electrode] = found.comfortable_ua / own_ua - 1.0
        else:
            self._outcome.weaker[electrode] = self._largest_ua[electrode] / found.cap_ua


def conditions_of(daemon: SteppedDaemon, method: Method, pulses: int = 10) -> Conditions:
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
        pulses=pulses,
        cap_ua=CAP_UA,
    )
