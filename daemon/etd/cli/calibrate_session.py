"""A run of `etd calibrate` on a daemon: arming, going through the electrodes, storing the result.

Owns: where answers come from, saving the progress, and what is stored and printed at the end.
Must not know: names of options, procedures (etd.calibrate), keys, the picture.
"""

from __future__ import annotations

import argparse
import datetime
import sys
from contextlib import ExitStack
from pathlib import Path
from random import randrange

import msgspec

from etd.calibrate.answers import Answerer
from etd.calibrate.asking import Presenter
from etd.calibrate.conditions import (
    Conditions,
    check_baseline,
    check_conditions,
    check_laws,
)
from etd.calibrate.course import Course
from etd.calibrate.modelled import FeltPresenter, ModelledBody
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.progress import (
    Progress,
    check_progress_folder,
    finished,
    load_progress,
    save_progress,
)
from etd.calibrate.stimulator import NotDelivered, Stimulator
from etd.cli import options
from etd.cli.calibrate_conditions import requested_conditions
from etd.cli.calibrate_kept import kept_of_restart, made_on, name_of_daemon
from etd.cli.calibrate_result import (
    marked,
    same_command,
    store,
    stored_lowered,
    tell_trials,
)
from etd.cli.calibrate_screen import Screen
from etd.cli.calibrate_stage import Stage
from etd.cli.calibrate_watch import Watch
from etd.cli.doubts import doubts_of, drift_in_words
from etd.cli.taken_name import check_name_is_theirs
from etd.cli.trials_file import TrialsFile, new_trials_path
from etd.cli.whole_taken_down import said_of_whole
from etd.client import Display, clock
from etd.files.paths import calibrating_file
from etd.protocol.calibration import MOST_SEED, Calibration
from etd.version import __version__
from etd_hal.compose import wall_time

#: So that a simulated calibration is the same each time.
SIMULATED_SEED = 1


class CalibrateSession:
    """One run of the command. Raises, when made: FileError, Refused (`bad_calibration`)."""

    def __init__(self, args: argparse.Namespace, display: Display, which: str) -> None:
        self._args = args
        self._display = display
        self._which = which
        self.stage = Stage(args, display)
        self._file = calibrating_file(name_of_daemon(args), which)
        check_progress_folder(self._file)
        self._baseline = display.calibration(args.baseline) if args.baseline else None
        conditions = check_conditions(requested_conditions(args, display.facts, self._baseline))
        check_name_is_theirs(args, display, which, conditions)
        has_baseline = self._baseline is not None
        check_laws(conditions, display.facts.stabilizers, has_baseline=has_baseline)
        if self._baseline is not None:
            check_baseline(conditions, self._baseline)
        self._in_use = stored_lowered(args, display, which, conditions)
        self._progress = self._begun(conditions)
        for electrode in args.leave_out:
            self._progress.leave_out(electrode)
        if args.skin_celsius is not None:
            self._progress.skin_celsius = args.skin_celsius
        self._screen = Screen(
            display.facts.array, self._progress, is_quiet=args.json, is_blind=args.blind
        )
        folder = Path() if args.out is None else args.out.parent
        begun, array = wall_time(), conditions.array
        path = new_trials_path(folder, which, array, begun, args.trials)
        self._trials = TrialsFile(path, conditions, clock.now_ns, clock.wall_offset_ns)
        self._is_simulated = args.answers == "simulated"
        #: Used instead of the screen for simulated answers, unless the output is JSON.
        self._watch = Watch(self._progress) if self._is_simulated and not args.json else None
        self._left: dict[int, str] = {}

    def run(self) -> None:
        """Raises: Stopped, Refused, DaemonGone."""
        progress = self._progress
        if not self._wanted() and not progress.is_whole_due and progress.in_doubt is None:
            return
        body = ModelledBody()
        with ExitStack() as stack:
            stack.callback(self._trials.close)
            stack.callback(self._in_use.tell)
            answerer: Answerer
            if self._is_simulated:
                answerer = SimulatedPerson(body.sense, self._progress.seed or 0)
                self.stage.arm()
            else:
                keys = self.stage.armed_keys(self._screen.ask, self._screen.heard)
                answerer = stack.enter_context(keys)
            if self._args.restart:
                save_progress(self._file, self._progress)
            # A run before this one may have ended, or been refused, before it was stored.
            self._store_lowered()
            stimulator = stack.enter_context(
                self.stage.stimulator(progress.conditions, answerer.wants_stop, body.hear)
            )
            presenter: Presenter = stimulator
            if self._is_simulated:
                presenter = FeltPresenter(stimulator, body)
            if self._watch is not None:
                stack.enter_context(self._watch)
            self._go_through(stimulator, presenter, answerer)

    def _go_through(self, stimulator: Stimulator, presenter: Presenter, answerer: Answerer) -> None:
        course = Course(
            self._progress,
            presenter,
            answerer,
            _today,
            baseline=self._baseline,
            on_progress=self._save,
            on_presented=self._shown.presented,
            on_answered=self._trials.answered,
            on_found=lambda _: self._shown.found(),
            on_drift=lambda drift, is_least: self._shown.advise(_rest_after(drift, is_least)),
            asks_sensation=self._args.ask_sensation,
        )
        self._shown.begin(len(self._wanted()))
        stimulator.open()
        course.run(self._wanted())
        self._left = course.left
        if not self._wanted():
            self._feel_whole(course)

    def _feel_whole(self, course: Course) -> None:
        """What cannot be presented leaves the levels as each electrode was accepted."""
        before = dict(self._progress.found)
        try:
            course.feel_whole()
        except NotDelivered as error:
            print(
                f"the whole array was not presented at once ({error.why}): levels were accepted"
                " one electrode at a time only",
                file=sys.stderr,
            )
        finally:
            if (said := said_of_whole(before, self._progress)) is not None:
                print(said, file=sys.stderr, flush=True)

    def settle(self) -> int:
        """Store a complete calibration in the daemon; otherwise report what is missing."""
        if missing := self._wanted():
            for electrode in missing:
                print(f"electrode {electrode}: {self._left.get(electrode)}", file=sys.stderr)
            options.answer_no(
                self._args,
                "unsettled",
                f"{len(missing)} electrodes have no result, so nothing is stored:"
                f" {same_command(self._args)} tries them again, --leave-out"
                f" {','.join(map(str, missing))} omits them",
                trials=self.trials,
            )
            tell_trials(self._args, self.trials)
            return 1
        gamma = 1.0 if self._baseline is None else self._baseline.gamma
        made = marked(
            self._display, finished(self._progress, _today(), f"etd {__version__}", gamma)
        )
        store(self._args, self._display, self._which, made, self._in_use, self._file)
        self._answer(made)
        return 0

    @property
    def trials(self) -> str | None:
        """The file that they are in, if there were any."""
        return self._trials.name

    # --- progress ----------------------------------------------------------------------------

    @property
    def saved_in(self) -> str:
        """The file with what is saved."""
        return str(self._file)

    @property
    def kept(self) -> str:
        """What is saved, of this run or an earlier one, and how to continue."""
        again = same_command(self._args)
        if self._progress.in_doubt is not None:
            return (
                f"{self._saved}; it was stopped at a presentation:"
                f" {again} asks first whether that was too strong"
            )
        if self._progress.found:
            return f"{self._saved}: {again} continues"
        if self._progress.lowered_ua:
            return f"{self._saved}: {again} continues and stays below it"
        return f"{self._saved}: the same command starts again"

    @property
    def _saved(self) -> str:
        if self._progress.found:
            return "the results are saved"
        if self._progress.lowered_ua:
            return "no electrode has a result yet; what was too strong is saved"
        return "no electrode has a result yet"

    def _begun(self, conditions: Conditions) -> Progress:
        """The saved progress. Raises: FileError if its conditions differ."""
        seed, here = self._args.seed, made_on(self._args, self._display)
        if self._args.restart or not self._file.exists():
            seed = self._new_seed() if seed is None else seed
            begun = Progress(conditions=conditions, seed=seed, made_on=here)
            kept = kept_of_restart(self._args, self._file, conditions)
            begun.lowered_ua, begun.together_ua, begun.in_doubt, _ = kept
            return begun
        progress = load_progress(self._file, conditions, seed, here)
        print(f"continuing: electrodes done so far: {len(progress.found)}", file=sys.stderr)
        if progress.troubled:
            where = ", ".join(map(str, progress.troubled))
            print(
                f"currents that were too strong are not repeated: electrodes {where}",
                file=sys.stderr,
            )
        return progress

    def _save(self, progress: Progress) -> None:
        """Raises: FileError, Refused."""
        save_progress(self._file, progress)
        self._store_lowered()

    def _store_lowered(self) -> None:
        """What was too strong is taken from what the person may be using. What is saved is of the
        baseline as it is now, so that the same command continues. Raises: FileError, Refused.
        """
        progress = self._progress
        self._in_use.lower(progress.left_ua)
        was = progress.conditions.baseline
        known = self._in_use.identity_of(self._args.baseline, was)
        if known != was:
            progress.conditions = msgspec.structs.replace(progress.conditions, baseline=known)
            save_progress(self._file, progress)

    def _new_seed(self) -> int:
        return SIMULATED_SEED if self._args.answers == "simulated" else randrange(MOST_SEED + 1)

    def _wanted(self) -> list[int]:
        return [
            electrode
            for electrode in self._progress.missing
            if electrode not in self._args.leave_out
        ]

    # --- the screen --------------------------------------------------------------------------

    @property
    def _shown(self) -> Screen | Watch:
        return self._screen if self._watch is None else self._watch

    # --- the result --------------------------------------------------------------------------

    def _answer(self, made: Calibration) -> None:
        count = self._progress.presentations
        if self._args.json:
            answer = {
                "ok": True,
                "name": self._which,
                "presentations": count,
                "too_strong": sorted(self._progress.lowered_ua),
                "trials": self.trials,
                "warning": "; ".join(doubts_of(made)) or None,
                "calibration": made,
            }
            print(msgspec.json.encode(answer).decode())
            return
        felt = [limits for limits in made.electrode if limits.felt]
        print(
            f"{self._which}: {len(felt)} of {len(made.electrode)} electrodes are felt, thresholds"
            f" {min(limits.threshold_ua for limits in felt)} to"
            f" {max(limits.threshold_ua for limits in felt)} uA\n{count} presentations,"
            f" order of seed {self._progress.seed}; {self._where()}"
        )
        if self.trials is not None:
            print(f"trials: {self.trials}")
        for doubt in doubts_of(made):
            print(doubt)

    def _where(self) -> str:
        """Where the calibration is stored; this command's fake board ends with its own."""
        if self._args.board is None:
            return f"`etd calibration show {self._which}`"
        if self._args.out is None:
            return "the fake's daemon ends now and discards it: --out FILE stores a copy"
        return f"stored in {self._args.out}"


def _rest_after(drift: float, is_least: bool) -> str:
    """Of at most two lines of a terminal."""
    if is_least:
        risen = f"at least {max(drift, 0.0):.0%}"
        first = f"The first electrode is not felt up to its cap now: risen by {risen}."
    else:
        first = f"The first electrode's threshold has {drift_in_words(drift, is_least=False)}."
    return f"{first}\nRest for five minutes: q, and later the same command."


def _today() -> datetime.date:
    return wall_time().date()
