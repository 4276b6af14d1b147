"""A run of `etd calibrate CODE --fit`: one state of the skin after another, and the exponent.

Owns: what the person is told to do between states, saving after each, what is stored and printed at
the end. Must not know: names of options, the states, the fit (etd.calibrate), keys.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from random import randrange

import msgspec

from etd.calibrate.answers import Answer
from etd.calibrate.conditions import check_baseline, check_conditions, check_laws
from etd.calibrate.course import Course
from etd.calibrate.exponent import NoFit
from etd.calibrate.fitting import (
    STATES,
    FitProgress,
    Fitting,
    SkinState,
    electrodes_to_ask,
    load_fit,
    save_fit,
)
from etd.calibrate.progress import Progress
from etd.calibrate.stimulator import Stimulator
from etd.calibrate.trial import Stopped
from etd.cli import options
from etd.cli.arming import armed_for
from etd.cli.calibrate_conditions import requested_conditions
from etd.cli.calibrate_result import cleared_first, same_command, store
from etd.cli.calibrate_screen import Screen
from etd.cli.calibrate_stage import stimulator_on
from etd.cli.keys import Keyboard, keyboard
from etd.cli.trials_file import TrialsFile, new_trials_path
from etd.client import Display, clock
from etd.files.paths import calibrating_file
from etd.protocol.calibration import MOST_SEED
from etd.protocol.exponent import FittedExponent
from etd_hal.compose import wall_time


class FitSession:
    """See the module. Raises, when made: FileError, Refused (`bad_calibration`)."""

    def __init__(self, args: argparse.Namespace, display: Display, which: str) -> None:
        self._args, self._display, self._which = args, display, which
        self._file = calibrating_file(args.name if args.board is None else "fake", f"{which}-fit")
        self._baseline = display.calibration(args.baseline)
        conditions = check_conditions(requested_conditions(args, display.facts, self._baseline))
        check_laws(conditions, display.facts.stabilizers, has_baseline=True)
        check_baseline(conditions, self._baseline)
        self._progress = self._begun(
            FitProgress(
                conditions=conditions,
                electrodes=electrodes_to_ask(self._baseline, args.electrodes),
                seed=randrange(MOST_SEED + 1) if args.seed is None else args.seed,
            )
        )
        self._fitting = Fitting(self._progress)
        self._screen = self._screen_of(self._fitting.progress_of_state())
        folder = Path() if args.out is None else args.out.parent
        name = f"{which}-fit"
        path = new_trials_path(folder, name, conditions.array, wall_time(), args.trials)
        self._trials = TrialsFile(path, conditions, clock.now_ns, clock.wall_offset_ns)

    def run(self) -> None:
        """Raises: Stopped, Refused, DaemonGone."""
        if self._fitting.state is None:
            return
        with ExitStack() as stack:
            stack.callback(self._trials.close)
            keys = stack.enter_context(
                keyboard(lambda question: self._screen.ask(question), self._heard)
            )
            at_once = self._args.board is not None or self._args.arm
            armed_for(self._display, keys, at_once=at_once)
            if self._args.restart:
                self._file.unlink(missing_ok=True)
            stimulator = stack.enter_context(
                stimulator_on(self._display, self._progress.conditions, keys.wants_stop)
            )
            stimulator.open()
            while (state := self._fitting.state) is not None:
                self._wait_for_skin(state, keys)
                self._ask_in(state, stimulator, keys)

    def _ask_in(self, state: SkinState, stimulator: Stimulator, keys: Keyboard) -> None:
        of_state = self._fitting.progress_of_state()
        self._screen = self._screen_of(of_state)
        course = Course(
            of_state,
            stimulator,
            keys,
            lambda: wall_time().date(),
            baseline=self._baseline,
            on_progress=self._lowered,
            on_presented=self._screen.presented,
            on_answered=self._trials.answered,
            on_threshold=lambda one: self._fitting.threshold_found(one, clock.now_ns() / 1e9),
            on_found=lambda _: self._screen.found(),
            fit=(self._fitting.caps_ua, self._fitting.least_ua),
        )
        course.run(self._progress.electrodes)
        for electrode in self._fitting.take(of_state):
            why = course.left.get(electrode, "no threshold up to its cap")
            self._say(f"electrode {electrode} is left out: {why}")
        save_fit(self._file, self._progress)
        self._say(f"{state.name}: done, {len(STATES) - self._progress.states} states to come")

    def _wait_for_skin(self, state: SkinState, keys: Keyboard) -> None:
        """Raises: Stopped."""
        number = self._progress.states + 1
        self._say(f"\nstate {number} of {len(STATES)}, {state.name}: {state.todo}")
        self._say("Then any key   (SPACE STOP   q pause)")
        ending = keys.ready(self._display.keep)
        if ending == "stop":
            self._display.stop()
        if ending is not None:
            raise Stopped(ending)

    # --- the result --------------------------------------------------------------------------

    def settle(self) -> int:
        """Store the calibration with its exponent in the daemon."""
        try:
            found = self._fitting.fit(wall_time().date())
        except NoFit as error:
            options.answer_no(self._args, "unsettled", f"no exponent: {error}", trials=self.trials)
            self._file.unlink(missing_ok=True)
            return 1
        made = msgspec.structs.replace(self._baseline, exponent=found)
        store(self._args, self._display, self._which, made, self._file)
        self._answer(found)
        return 0

    def _answer(self, found: FittedExponent) -> None:
        if self._args.json:
            answer = {
                "ok": True,
                "name": self._which,
                "exponent": found,
                "usable": found.why_not is None,
                "why_not": found.why_not,
                "trials": self.trials,
            }
            print(msgspec.json.encode(answer).decode())
            return
        print(
            f"{self._which}: k = {found.k:.2f} ({found.low:.2f} to {found.high:.2f}); it explains"
            f" {found.explained:.0%} of what thresholds of {len(found.electrodes)} electrodes did"
            f" in {found.states} states; the skin's resistance changed {found.fold:.1f}-fold"
        )
        if found.why_not is not None:
            print(f"power_law is not for this person: {found.why_not}")
        if self.trials is not None:
            print(f"trials: {self.trials}")

    @property
    def trials(self) -> str | None:
        """The file that they are in, if there were any."""
        return self._trials.name

    def after(self, stopped: Stopped) -> str:
        """What is saved, and how to continue."""
        done = self._progress.states
        command = cleared_first(self._args, stopped) + same_command(self._args)
        return f"{stopped}; states that are over: {done}: {command} continues"

    # --- on the way --------------------------------------------------------------------------

    def _begun(self, asked_for: FitProgress) -> FitProgress:
        """The saved progress. Raises: FileError if it was begun otherwise."""
        if self._args.restart or not self._file.exists():
            return asked_for
        saved = load_fit(self._file, asked_for, has_seed=self._args.seed is not None)
        print(f"continuing: states that are over: {saved.states}", file=sys.stderr)
        return saved

    def _lowered(self, of_state: Progress) -> None:
        """What was too strong is kept, whatever comes next."""
        self._fitting.lower(of_state)
        save_fit(self._file, self._progress)

    def _screen_of(self, of_state: Progress) -> Screen:
        return Screen(
            self._display.facts.array,
            of_state,
            is_quiet=self._args.json,
            is_blind=self._args.blind,
            asked=len(self._progress.electrodes),
        )

    def _heard(self, answer: Answer | None) -> None:
        self._screen.heard(answer)

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr if self._args.json else sys.stdout, flush=True)
