"""The k of a modelled finger's own: what `etd calibrate --fit` would find on it, or why nothing.

Owns: bringing the finger's skin into the states, a person who answers by what this body feels, and
what k is true of it. The procedure, the fit and its refusals are the daemon's own. Must not know:
engines, laws, what becomes of the k.

The states are those of `etd.calibrate.fitting`, as `etd_body.states` has them. What they do to a
threshold is the kind's; use raises it where the kind adapts. The person is the simulated one, who
errs a little.

    python tests/bench/steady_fit_own.py [--seeds 7401 7402]      prints the k of all bodies
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from math import exp
from pathlib import Path

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import numpy as np  # noqa: E402

from bench import fresh_seeds  # noqa: E402
from bench.steady_skin import (  # noqa: E402
    MOST_CAP_UA,
    WIDTH_US,
    body_of,
    calibrated,
    conditions_of,
    seen_ohm,
)
from etd.calibrate.exponent import NoFit  # noqa: E402
from etd.calibrate.fitting import FitProgress, Fitting, electrodes_to_ask  # noqa: E402
from etd.calibrate.person import Felt, SimulatedPerson  # noqa: E402
from etd.calibrate.stimulator import Delivered  # noqa: E402
from etd.files.configuration import fake_config  # noqa: E402
from etd.protocol.exponent import FittedExponent  # noqa: E402
from etd.pulse.measured import BEND_UA  # noqa: E402
from etd_body import states  # noqa: E402
from etd_body.interface import Side  # noqa: E402
from etd_body.kinds import BodyKind  # noqa: E402
from etd_body.living import LivingBody  # noqa: E402
from etd_body.states import SkinState, StatedCourse  # noqa: E402
from fit_scenes import TODAY, ask_in_this_state  # noqa: E402

#: From one presentation to the next, and from one state to the next.
_EACH_S, _BETWEEN_S = 3.0, 120.0
#: Of strength over current, as `etd_body.sensation` has it; and of one reading of a resistance.
_STRENGTH_EXPONENT, _READING_SIGMA = 1.2, 0.02


class _Finger:
    """Implements `Presenter`: one pulse of the body stands for a presentation."""

    def __init__(self, body: LivingBody, course: StatedCourse, seed: int) -> None:
        self._body = body
        self._course = course
        self._random = np.random.default_rng([seed, 10])
        self._last = (0, 0)
        self._pain = 0.0
        self.now_s = 0.0
        body.skin.course = course
        body.look_at(0)

    def begin(self, state: SkinState) -> None:
        self.now_s += _BETWEEN_S
        self._course.state = state

    def present(self, electrode: int, current_ua: int) -> Delivered:
        self._pass_time()
        self._last = electrode, current_ua
        count = self._body.electrode_count
        sides = tuple(Side.SOURCE if other == electrode else Side.GROUND for other in range(count))
        at_ns = int(self.now_s * 1e9)
        self._body.take_felt()
        self._body.drive(at_ns, current_ua, sides)
        self._body.drive(at_ns + WIDTH_US * 1_000, 0.0, sides)
        self._pain = self._body.take_felt().pain[electrode]
        error = exp(self._random.normal(0.0, _READING_SIGMA))
        ohm = seen_ohm(self._body, electrode, current_ua)
        return Delivered(electrode, current_ua, round(ohm * error))

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        raise AssertionError("a fit asks one electrode at a time")

    def silence(self, electrode: int) -> Delivered:
        self._pass_time()
        self._last, self._pain = (electrode, 0), 0.0
        return Delivered(electrode, 0, None)

    def sense(self, electrode: int) -> Felt:
        shown, current_ua = self._last
        assert shown == electrode
        times = self._body.times_threshold(electrode, current_ua, WIDTH_US) if current_ua else 0.0
        return Felt(times**_STRENGTH_EXPONENT, self._pain)

    def pause(self, seconds: float) -> None:
        self.now_s += seconds

    def keep(self) -> None:
        """No lease lapses here."""

    def stop(self) -> None:
        raise AssertionError("nobody stops")

    def _pass_time(self) -> None:
        self.now_s += _EACH_S
        self._body.look_at(int(self.now_s * 1e9))


@cache
def own_fit(
    kind: BodyKind, seed: int, electrodes: int, limit_ua: int = int(MOST_CAP_UA)
) -> FittedExponent | str:
    """What is stored in the calibration of this finger; in words, why nothing is fitted. Nothing
    above `limit_ua` is presented.
    """
    loaded = fake_config(electrodes=electrodes)
    made = calibrated(seed, loaded.board, loaded.array, kind)
    body = body_of(seed, loaded.board, loaded.array, kind)
    places = list(zip(loaded.array.x_mm, loaded.array.y_mm, strict=True))
    finger = _Finger(body, StatedCourse(places, seed=seed), seed)
    progress = FitProgress(
        conditions=conditions_of(made, limit_ua),
        electrodes=electrodes_to_ask(made),
        seed=seed,
        board=loaded.board.name,
        leak_ohm=loaded.board.source.leak_ohm,
    )
    fitting, person = Fitting(progress, made), SimulatedPerson(finger.sense, seed)
    for state in states.STATES:
        finger.begin(state)
        ask_in_this_state(fitting, progress.electrodes, finger, person, made)
    try:
        return fitting.fit(TODAY)
    except NoFit as error:
        return str(error)


def true_k(kind: BodyKind, seed: int, electrodes: int, asked: Sequence[int]) -> float:
    """The slope, within the electrodes that were asked, of true thresholds over resistances as at
    no current: what a person finds who never errs, without a limit.
    """
    loaded = fake_config(electrodes=electrodes)
    body = body_of(seed, loaded.board, loaded.array, kind)
    places = list(zip(loaded.array.x_mm, loaded.array.y_mm, strict=True))
    course = StatedCourse(places, seed=seed)
    body.skin.course = course
    threshold, resistance = np.zeros((2, len(states.STATES), len(asked)))
    for number, course.state in enumerate(states.STATES):
        body.look_at(number)
        for place, electrode in enumerate(asked):
            now_ua = body.commanded_threshold_ua(electrode, WIDTH_US)
            ohm = seen_ohm(body, electrode, now_ua) * (now_ua + BEND_UA) / BEND_UA
            threshold[number, place], resistance[number, place] = np.log((now_ua, ohm))
    threshold -= threshold.mean(axis=0)
    resistance -= resistance.mean(axis=0)
    return -float((threshold * resistance).sum() / (resistance**2).sum())


def said(found: FittedExponent | str) -> str:
    """In words."""
    if isinstance(found, str):
        return f"refused: {found}"
    verdict = "usable" if found.why_not is None else f"refused: {found.why_not}"
    return (
        f"k {found.k:.2f} ({found.low:.2f} to {found.high:.2f}), explains {found.explained:.0%},"
        f" {found.fold:.1f}-fold: {verdict}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(fresh_seeds.STEADY))
    parser.add_argument("--electrodes", type=int, default=64)
    asked = parser.parse_args()
    for kind in BodyKind:
        for seed in asked.seeds:
            print(f"{kind} {seed}: {said(own_fit(kind, seed, asked.electrodes))}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
