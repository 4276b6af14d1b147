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
from etd.calibrate.conditions import (
    check_baseline,
    check_conditions,
    check_date,
    check_laws,
)
from etd.calibrate.course import Course
from etd.calibrate.exponent import NoFit
from etd.calibrate.fitting import (
    STATES,
    FitProgress,
    Fitting,
    SkinState,
    check_pause,
    electrodes_to_ask,
    load_fit,
)
from etd.calibrate.in_doubt import InDoubt
from etd.calibrate.progress import Progress, check_progress_folder, save_progress
from etd.calibrate.stimulator import Stimulator
from etd.cli import options
from etd.cli.calibrate_added import calibrated_first, otherwise
from etd.cli.calibrate_conditions import requested_conditions
from etd.cli.calibrate_kept import kept_of_restart, made_on, name_of_daemon
from etd.cli.calibrate_result import (
    kept_lower,
    same_command,
    store,
    stored_lowered,
    tell_trials,
)
from etd.cli.calibrate_screen import Screen
from etd.cli.calibrate_session import SIMULATED_SEED
from etd.cli.calibrate_stage import Stage
from etd.cli.calibration_shown import k_in_words
from etd.cli.false_alarms import said_of_false_alarms_of_fit
from etd.cli.fit_wearer import PersonAtKeys, SimulatedWearer, Wearer
from etd.cli.taken_name import check_name_is_theirs
from etd.cli.trials_file import TrialsFile, new_trials_path
from etd.client import Display, clock
from etd.files.paths import calibrating_file
from etd.protocol.calibration import MOST_SEED, Calibration
from etd.protocol.exponent import FittedExponent
from etd.protocol.text import shown
from etd_hal.compose import wall_time

_OPTION = "--fit"


class FitSession:
    """See the module. Raises, when made: FileError, Refused (`bad_calibration`)."""

    def __init__(self, args: argparse.Namespace, display: Display, which: str) -> None:
        self._args, self._display, self._which = args, display, which
        self.stage = Stage(args, display)
        self._file = calibrating_file(name_of_daemon(args), which, ".fit")
        check_progress_folder(self._file)
        self._is_simulated = args.answers == "simulated"
        #: Kept for this run: a clock that is set meanwhile does not make a drift.
        self._wall_offset_ns = clock.wall_offset_ns()
        with calibrated_first(_OPTION):
            self._baseline = display.calibration(args.baseline)
        conditions = check_conditions(requested_conditions(args, display.facts, self._baseline))
        check_name_is_theirs(args, display, which, conditions)
        check_laws(conditions, display.facts.stabilizers, has_baseline=True)
        check_baseline(conditions, self._baseline, otherwise(_OPTION))
        check_date(self._baseline, wall_time().date())
        self._in_use = stored_lowered(args, display, which, conditions)
        self._progress = self._begun(
            FitProgress(
                conditions=conditions,
                electrodes=self._electrodes_to_ask(conditions.presented_ua),
                seed=self._new_seed() if args.seed is None else args.seed,
                board=display.facts.board.name,
                leak_ohm=display.facts.board.leak_ohm,
                made_on=made_on(args, display),
            )
        )
        self._fitting = Fitting(self._progress, self._baseline)
        self._screen = self._screen_of(self._fitting.progress_of_state())
        folder = Path() if args.out is None else args.out.parent
        name = f"{which}-fit"
        path = new_trials_path(folder, name, conditions.array, wall_time(), args.trials)
        self._trials = TrialsFile(path, conditions, clock.now_ns, clock.wall_offset_ns)

        #: What was presented last, in the state before.
        self._last: InDoubt | None = None

    def run(self) -> None:
        """Raises: Stopped, Refused, DaemonGone."""
        if self._fitting.state is None or self._fitting.is_lost:
            return
        self._tell_above_caps()
        with ExitStack() as stack:
            stack.callback(self._trials.close)
            stack.callback(self._in_use.tell)
            wearer = self._armed_wearer(stack)
            if self._args.restart:
                save_progress(self._file, self._progress)
            # A run before this one may have ended, or been refused, before it was stored.
            self._store_lowered()
            conditions = self._progress.conditions
            stimulator = stack.enter_context(
                self.stage.stimulator(conditions, wearer.answerer.wants_stop, wearer.hear)
            )
            stimulator.open()
            while (state := self._fitting.state) is not None and not self._fitting.is_lost:
                self._ask_in(state, wearer, stimulator)

    def _tell_above_caps(self) -> None:
        """Before the board is armed."""
        if not (above_ua := self._fitting.above_caps_ua):
            return
        print(
            f"on damp skin, in {sum(state.is_damp for state in STATES)} of {len(STATES)} states,"
            f" {len(above_ua)} of {len(self._progress.electrodes)} electrodes may get more than"
            f" their caps in {self._args.baseline}, up to {max(above_ua.values())} uA, a step at a"
            " time; on dry skin none does",
            file=sys.stderr,
            flush=True,
        )

    def _armed_wearer(self, stack: ExitStack) -> Wearer:
        """Raises: Stopped, Refused."""
        if self._is_simulated:
            self.stage.arm()
            return SimulatedWearer(self._progress.seed)
        keys = stack.enter_context(
            self.stage.armed_keys(lambda question: self._screen.ask(question), self._heard)
        )
        return PersonAtKeys(keys, self._say)

    def _ask_in(self, state: SkinState, wearer: Wearer, stimulator: Stimulator) -> None:
        number = self._progress.states
        of_state = self._fitting.progress_of_state()
        self._screen = self._screen_of(of_state)
        course = Course(
            of_state,
            wearer.presenter(stimulator),
            wearer.answerer,
            lambda: wall_time().date(),
            baseline=self._baseline,
            on_progress=self._lowered,
            on_presented=self._screen.presented,
            on_answered=self._trials.answered,
            on_threshold=lambda one: self._fitting.threshold_found(one, self._now_s()),
            on_found=lambda _: self._screen.found(),
            fit=(self._fitting.caps_ua, self._fitting.least_ua),
            last=self._last,
        )
        self._say(f"\nstate {number + 1} of {len(STATES)}, {state.name}: {state.todo}")
        course.wait(lambda: wearer.come_into(number, stimulator))
        check_pause(self._progress, self._now_s(), str(self._file))
        course.run(self._progress.electrodes)
        self._last = course.last
        for electrode in self._fitting.take(of_state):
            why = course.left.get(electrode, "no threshold up to its cap")
            self._say(f"electrode {electrode} has no threshold in this state: {why}")
        save_progress(self._file, self._progress)
        self._say(f"{state.name}: done, {len(STATES) - self._progress.states} states to come")

    # --- the result --------------------------------------------------------------------------

    def settle(self) -> int:
        """Store the calibration with its exponent in the daemon."""
        try:
            found = self._fitting.fit(wall_time().date())
        except NoFit as error:
            said = f"no exponent: {error}; the answers are kept in {self._file}, and --restart"
            said = f"{said} asks all states again"
            options.answer_no(self._args, "unsettled", said, trials=self.trials)
            tell_trials(self._args, self.trials)
            return 1
        made = self._fitting.lowered()
        if (stored := self._in_use[self._which]) is not None:
            made = kept_lower(made, stored)
        made = msgspec.structs.replace(made, exponent=found)
        store(self._args, self._display, self._which, made, self._in_use, self._file)
        self._answer(found, made)
        return 0

    def _answer(self, found: FittedExponent, made: Calibration) -> None:
        why_not = found.why_not_in(made.date, wall_time().date())
        doubt = said_of_false_alarms_of_fit(made)
        if self._args.json:
            answer = {
                "ok": True,
                "name": self._which,
                "exponent": found,
                "usable": why_not is None,
                "why_not": why_not,
                "warning": doubt,
                "trials": self.trials,
            }
            print(msgspec.json.encode(answer).decode())
            return
        print(f"{self._which}: {k_in_words(found)}")
        if why_not is not None:
            print(f"power_law is not for this person: {why_not}")
        if doubt is not None:
            print(shown(doubt))
        if self.trials is not None:
            print(f"trials: {self.trials}")

    @property
    def trials(self) -> str | None:
        """The file that they are in, if there were any."""
        return self._trials.name

    @property
    def saved_in(self) -> str:
        """The file with what is saved."""
        return str(self._file)

    @property
    def kept(self) -> str:
        """What is saved, and how to continue."""
        done, again = self._progress.states, same_command(self._args)
        if self._progress.in_doubt is not None:
            again = (
                f"it was stopped at or after a presentation: {again} asks first whether that was"
            )
            return f"states that are over: {done}; {again} too strong"
        return f"states that are over: {done}: {again} continues"

    def _now_s(self) -> float:
        """Of the wall clock."""
        return (clock.now_ns() + self._wall_offset_ns) / 1e9

    # --- on the way --------------------------------------------------------------------------

    def _begun(self, asked_for: FitProgress) -> FitProgress:
        """The saved progress. Raises: FileError if it was begun otherwise."""
        if not self._is_begun:
            kept = kept_of_restart(self._args, self._file, asked_for.conditions)
            asked_for.lowered_ua, _, asked_for.in_doubt, _ = kept
            return asked_for
        both = {"seed": self._args.seed, "electrodes": self._args.electrodes or None}
        named = [key for key, value in both.items() if value is not None]
        saved = load_fit(self._file, asked_for, named)
        check_pause(saved, self._now_s(), str(self._file))
        print(f"continuing: states that are over: {saved.states}", file=sys.stderr)
        return saved

    @property
    def _is_begun(self) -> bool:
        return not self._args.restart and self._file.exists()

    def _electrodes_to_ask(self, most_ua: int) -> tuple[int, ...]:
        """Of a fit that goes on: what was too strong in it may have left one of its electrodes no
        room above its threshold, so those that are named only have to be its own. Raises:
        FileError.
        """
        if self._is_begun:
            return tuple(sorted(set(self._args.electrodes)))
        return electrodes_to_ask(self._baseline, self._args.electrodes, most_ua)

    def _new_seed(self) -> int:
        return SIMULATED_SEED if self._is_simulated else randrange(MOST_SEED + 1)

    def _lowered(self, of_state: Progress) -> None:
        """What was too strong is kept, and taken from the calibration at once: the fit may never be
        finished. Raises: FileError, Refused.
        """
        self._fitting.lower(of_state)
        save_progress(self._file, self._progress)
        self._store_lowered()

    def _store_lowered(self) -> None:
        """What is saved is of the baseline as it is now, so that the same command continues.
        Raises: FileError, Refused.
        """
        progress = self._progress
        self._in_use.lower(self._fitting.left_ua)
        was = progress.conditions.baseline
        known = self._in_use.identity_of(self._args.baseline, was)
        if known != was:
            progress.conditions = msgspec.structs.replace(progress.conditions, baseline=known)
            save_progress(self._file, progress)

    def _screen_of(self, of_state: Progress) -> Screen:
        return Screen(
            self._display.facts.array,
            of_state,
            is_quiet=self._args.json or self._is_simulated,
            is_blind=self._args.blind,
            asked=len(self._progress.electrodes),
        )

    def _heard(self, answer: Answer | None) -> None:
        self._screen.heard(answer)

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr if self._args.json else sys.stdout, flush=True)
