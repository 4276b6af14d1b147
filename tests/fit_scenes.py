"""A fit of an exponent, from the first state of the skin to the last, of a simulated person.

Owns: a skin whose thresholds follow its resistance by k, and going through all states. Must not
know: what is judged.
"""

from __future__ import annotations

import datetime
import math
import random
from collections.abc import Mapping, Sequence
from typing import Protocol

import msgspec

from calibrate_scenes import ROW
from etd.calibrate.asking import Presenter
from etd.calibrate.conditions import Conditions
from etd.calibrate.course import Course
from etd.calibrate.exponent import NoFit
from etd.calibrate.fitting import FitProgress, Fitting, electrodes_to_ask
from etd.calibrate.person import Felt, ResponseModel, SimulatedPerson
from etd.calibrate.progress import Progress, finished
from etd.calibrate.stimulator import Delivered
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import FileError
from etd.protocol.exponent import FittedExponent
from etd.pulse.measured import BEND_UA

BOARD = "kajimoto-hv507"
N, TODAY = 8, datetime.date(2026, 1, 15)
#: Who adapts while he is asked, pain and all, as it follows the threshold through the states; of
#: whom pain stays, which leaves little between the two; and who has every weakness at once.
ADAPTING = ResponseModel(adaptation=0.6, pain_adaptation=0.6)
PAIN_STAYS = ResponseModel(adaptation=0.6)
POOR = ResponseModel(
    lapses=0.05,
    false_alarms=0.15,
    slips=0.03,
    drift=0.01,
    adaptation=0.6,
    pain_adaptation=0.6,
    noise=0.08,
)
CONDITIONS = msgspec.structs.replace(
    ROW, method="staircase", array="pad-8", electrodes=N, cap_ua=4_000
)
#: By how much the skin resists less than dry, in each of the states.
FALLS = (1.0, 3.0, 1.15, 2.3, 1.1)


class StateSkin:
    """Implements `Presenter`: thresholds that follow the resistance by k, and pain above them."""

    def __init__(self, k: float, seed: int) -> None:
        chance = random.Random(seed)
        self.k = k
        self.threshold_ua = [600.0 * math.exp(chance.gauss(0.0, 0.25)) for _ in range(N)]
        self.dry_ohm = [80e3 * math.exp(chance.gauss(0.0, 0.3)) for _ in range(N)]
        self.fall = 1.0
        self.presented: list[tuple[int, int]] = []
        self.now_s = 0.0

    def present(self, electrode: int, current_ua: int) -> Delivered:
        self.presented.append((electrode, current_ua))
        self.now_s += 3.0
        ohm = self.dry_ohm[electrode] / self.fall * BEND_UA / (BEND_UA + current_ua)
        return Delivered(electrode, current_ua, round(ohm))

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        raise AssertionError("a fit asks one electrode at a time")

    def silence(self, electrode: int) -> Delivered:
        self.presented.append((electrode, 0))
        self.now_s += 3.0
        return Delivered(electrode, 0, None)

    def sense(self, electrode: int) -> Felt:
        shown, current_ua = self.presented[-1]
        assert shown == electrode
        strength = current_ua / self.threshold_now_ua(electrode)
        return Felt(strength, strength / 2.0)

    def threshold_now_ua(self, electrode: int) -> float:
        return self.threshold_ua[electrode] * math.pow(self.fall, self.k)

    def pause(self, seconds: float) -> None:
        self.now_s += seconds

    def keep(self) -> None:
        """No lease lapses here."""

    def stop(self) -> None:
        raise AssertionError("nobody stops")


def baseline(skin: StateSkin) -> Calibration:
    return Calibration(
        **{
            key: getattr(CONDITIONS, key)
            for key in set(Conditions.__struct_fields__) & set(Calibration.__struct_fields__)
        },
        date=TODAY,
        program="test",
        electrode=tuple(
            ElectrodeLimits(
                threshold_ua=round(ua), comfortable_ua=round(1.5 * ua), cap_ua=round(1.6 * ua)
            )
            for ua in skin.threshold_ua
        ),
    )


def calibrated(skin: StateSkin, seed: int, model: ResponseModel) -> Calibration:
    """What this person's calibration finds, who adapts while it is made, and rests after it."""
    progress = Progress(conditions=CONDITIONS, seed=seed)
    person = SimulatedPerson(skin.sense, seed + 1, model)
    Course(progress, skin, person, lambda: TODAY).run(range(N))
    skin.presented.clear()
    return finished(progress, TODAY, "test")


def begun(skin: StateSkin, seed: int, made: Calibration | None = None) -> FitProgress:
    electrodes = electrodes_to_ask(made or baseline(skin))
    return FitProgress(
        conditions=CONDITIONS, electrodes=electrodes, seed=seed, board=BOARD, leak_ohm=66_000
    )


class Timed(Presenter, Protocol):
    """A presenter that knows how much time has passed on its skin."""

    now_s: float


def ask_in_this_state(
    fitting: Fitting,
    electrodes: Sequence[int],
    presenter: Timed,
    person: SimulatedPerson,
    made: Calibration,
) -> None:
    """Ask for the thresholds of these electrodes in the state that the skin is in."""
    of_state = fitting.progress_of_state()
    course = Course(
        of_state,
        presenter,
        person,
        lambda: TODAY,
        baseline=made,
        on_progress=fitting.lower,
        on_threshold=lambda one: fitting.threshold_found(one, presenter.now_s),
        fit=(fitting.caps_ua, fitting.least_ua),
    )
    course.run(electrodes)
    fitting.take(of_state)


def ask_all(
    skin: StateSkin,
    progress: FitProgress,
    seed: int,
    model: ResponseModel = ADAPTING,
    until: int = len(FALLS),
    made: Calibration | None = None,
) -> Fitting:
    """In the states that are still to come, up to this number."""
    made = made or baseline(skin)
    fitting = Fitting(progress, made)
    person = SimulatedPerson(skin.sense, seed, model)
    while progress.states < until:
        skin.fall = FALLS[progress.states]
        skin.now_s += 120.0
        ask_in_this_state(fitting, progress.electrodes, skin, person, made)
    return fitting


def found(k: float, seed: int, model: ResponseModel) -> FittedExponent | None:
    """None also of whom a calibration finds too few electrodes that can be asked."""
    skin = StateSkin(k, seed)
    try:
        made = calibrated(skin, seed, model)
        return ask_all(skin, begun(skin, seed, made), seed, model, made=made).fit(TODAY)
    except (NoFit, FileError):
        return None
