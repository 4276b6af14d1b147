"""A run of `etd calibrate CODE --adaptation`: all electrodes in use for minutes, and what is felt.

Owns: bringing them up to level 1 first, what is told on the way, what is stored and printed at the
end. Must not know: names of options, when it is asked and what counts (etd.calibrate), keys.

No answer is saved before its end: it takes some 17 minutes, and touch recovers in a pause.
What was too strong is stored at once, in the levels.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path

import msgspec

from etd.calibrate.adaptation import (
    LIES_PART,
    QUESTIONS,
    adaptation_of,
    before_use,
    currents_in_use,
    in_use,
    take_down_from_use,
    take_down_on_the_way,
)
from etd.calibrate.answers import Answer, Answerer, Ask, Presentation
from etd.calibrate.asking import Presenter
from etd.calibrate.conditions import check_baseline, check_conditions, check_date, check_laws
from etd.calibrate.course import Course
from etd.calibrate.modelled import FeltPresenter, ModelledBody
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.trial import TooStrongSaid
from etd.cli.calibrate_added import calibrated_first, otherwise
from etd.cli.calibrate_conditions import requested_conditions
from etd.cli.calibrate_result import kept_lower, store, stored_lowered, tell_trials
from etd.cli.calibrate_screen import Screen
from etd.cli.calibrate_session import SIMULATED_SEED
from etd.cli.calibrate_stage import Stage
from etd.cli.taken_name import check_name_is_theirs
from etd.cli.trials_file import TrialsFile, new_trials_path
from etd.cli.whole_taken_down import said_of_whole
from etd.client import Display, clock
from etd.files.raises_in_words import raises_in_words
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.calibration import Calibration
from etd.protocol.errors import EtdError, FileError
from etd_hal.compose import wall_time

_OPTION = "--adaptation"
#: Simulated answers are not shown one by one.
_TELL_EACH = 10
_TODO = (
    "Lay the finger on as for the calibration, after five minutes without stimulation, and leave it"
    " where it is. It lies for {:g} s; then all electrodes together, up to level 1; then {:g} s in"
    " use, at one strength: remember how strong it is at first."
)
_SITE_FORBIDS = (
    "body site {} lets no answer raise a level (felt_may_raise = false): what is found is stored,"
    " and changes nothing here"
)


class AdaptationSession:
    """See the module. Raises, when made: FileError, Refused (`bad_calibration`)."""

    def __init__(self, args: argparse.Namespace, display: Display, which: str) -> None:
        self._args, self._display, self._which = args, display, which
        self.stage = Stage(args, display)
        self._is_simulated = args.answers == "simulated"
        with calibrated_first(_OPTION):
            self._baseline = display.calibration(args.baseline)
        conditions = check_conditions(requested_conditions(args, display.facts, self._baseline))
        check_name_is_theirs(args, display, which, conditions)
        check_laws(conditions, display.facts.stabilizers, has_baseline=True)
        check_baseline(conditions, self._baseline, otherwise(_OPTION))
        check_date(self._baseline, wall_time().date())
        self._conditions = conditions
        self._whole = before_use(conditions, self._baseline)
        self._before = dict(self._whole.found)
        self._in_use = stored_lowered(args, display, which, conditions)
        stored = self._in_use[which]
        if stored is not None and kept_lower(self._baseline, stored) != self._baseline:
            raise FileError(
                "the baseline",
                "electrode",
                f"{which} has lower caps than {args.baseline}: something was too strong since",
                f"--baseline {which}, or another name with --as",
            )
        if not self._whole.level_1_ua:
            raise FileError(
                "the calibration",
                "electrode",
                f"no electrode of {args.baseline} was felt",
                "calibrate again: nothing can be shown of it",
            )
        self._screen = Screen(
            display.facts.array,
            self._whole,
            is_quiet=args.json or self._is_simulated,
            is_blind=args.blind,
        )
        folder = Path() if args.out is None else args.out.parent
        path = new_trials_path(
            folder, f"{which}-adaptation", conditions.array, wall_time(), args.trials
        )
        self._trials = TrialsFile(path, conditions, clock.now_ns, clock.wall_offset_ns)
        self._answers: list[Answer] = []
        self._asked = 0
        self._last_whole: Answer | None = None
        #: What was presented last, where that was answered and not too strong.
        self._accepted: Presentation | None = None

    def run(self) -> None:
        """Raises: Stopped, NotDelivered, Refused, DaemonGone, FileError."""
        body, use_s = ModelledBody(), self._args.use_s
        with ExitStack() as stack:
            stack.callback(self._trials.close)
            if not self._display.facts.felt_may_raise:
                self._say(_SITE_FORBIDS.format(self._display.facts.body_site))
            self._say(_TODO.format(LIES_PART * use_s, use_s))
            answerer = self._armed_answerer(stack, body)
            stimulator = stack.enter_context(
                self.stage.stimulator(self._conditions, answerer.wants_stop, body.hear)
            )
            stimulator.open()
            presenter: Presenter = stimulator
            if self._is_simulated:
                presenter = FeltPresenter(stimulator, body)
            presenter.pause(LIES_PART * use_s)
            try:
                self._feel_whole(presenter, answerer)
                self._use(presenter, answerer)
            except BaseException:
                self._store_in_the_end()
                raise

    def _armed_answerer(self, stack: ExitStack, body: ModelledBody) -> Answerer:
        """Raises: Stopped, Refused."""
        if self._is_simulated:
            self.stage.arm()
            seed = SIMULATED_SEED if self._args.seed is None else self._args.seed
            return SimulatedPerson(body.sense, seed)
        return stack.enter_context(self.stage.armed_keys(self._screen.ask, self._screen.heard))

    def _feel_whole(self, presenter: Presenter, answerer: Answerer) -> None:
        """Up to level 1; what is too strong takes all down."""
        course = Course(
            self._whole,
            presenter,
            answerer,
            lambda: wall_time().date(),
            baseline=self._baseline,
            on_progress=lambda _: self._store_taken_down(),
            on_presented=self._screen.presented,
            on_answered=self._whole_answered,
        )
        try:
            course.feel_whole()
        except TooStrongSaid:
            take_down_on_the_way(self._whole, self._accepted)
            self._store_taken_down()
            raise
        if not currents_in_use(self._whole, self._baseline.gamma):
            raise _not_as_calibrated(
                "all together was too strong down to below what is felt on each electrode"
            )
        if self._last_whole == "not_felt":
            raise _not_as_calibrated("all electrodes together are not felt at level 1")

    def _whole_answered(self, presented: Presentation, ask: Ask, answer: Answer | None) -> None:
        self._last_whole = answer
        self._accepted = None if answer in (None, "too_strong") else presented
        self._trials.answered(presented, ask, answer)

    def _use(self, presenter: Presenter, answerer: Answerer) -> None:
        self._say(f"in use, for {self._args.use_s:g} s: remember how strong it is now")
        gamma = self._baseline.gamma
        whole = self._whole
        accepted = dict(whole.found), dict(whole.together_ua), whole.is_whole_accepted

        def take_down() -> None:
            take_down_from_use(whole, gamma)
            self._store_taken_down()

        def give_back() -> None:
            found, together_ua, whole.is_whole_accepted = accepted
            whole.found, whole.together_ua = dict(found), dict(together_ua)
            self._store_taken_down()

        self._answers = in_use(
            presenter,
            answerer,
            currents_in_use(self._whole, gamma),
            self._args.use_s,
            lambda: clock.now_ns() / 1e9,
            self._presented,
            self._trials.answered,
            take_down,
            give_back,
        )

    def _presented(self, presented: Presentation) -> None:
        self._asked += 1
        if not self._is_simulated or self._asked % _TELL_EACH == 0:
            self._screen.advise(f"question {self._asked} of {QUESTIONS}")
        self._screen.presented(presented)

    # --- the result --------------------------------------------------------------------------

    def settle(self) -> int:
        """Store the calibration with what was found in the daemon."""
        today = wall_time().date()
        found = adaptation_of(self._answers, self._args.use_s, today)
        made = self._made(found)
        store(self._args, self._display, self._which, made, self._in_use)
        self._tell_taken_down(f"{self._which} is stored so")
        why_not = found.why_not_in(made.date, today)
        if self._args.json:
            answer = {
                "ok": True,
                "name": self._which,
                "adaptation": found,
                "usable": why_not is None,
                "why_not": why_not,
                "trials": self.trials,
            }
            print(msgspec.json.encode(answer).decode())
            return 0
        print(f"{self._which}: {found.in_words}")
        print(raises_in_words(why_not, found))
        tell_trials(self._args, self.trials)
        return 0

    def _made(self, found: MeasuredAdaptation) -> Calibration:
        """The levels are those that were accepted now."""
        return msgspec.structs.replace(
            self._baseline,
            electrode=tuple(self._whole.found[one] for one in sorted(self._whole.found)),
            is_whole_accepted=self._whole.is_whole_accepted or None,
            adaptation=found,
        )

    def _store_taken_down(self) -> None:
        """At once, before anything else is presented: what was too strong must not come again,
        whatever becomes of this process, and what was measured before is of other levels. Raises:
        Refused.
        """
        self._in_use.lower(self._whole.left_ua)

    def _store_in_the_end(self) -> None:
        """However it ends. Nothing is presented any more."""
        try:
            self._store_taken_down()
        except EtdError as error:
            self._tell_taken_down(
                f"{' and '.join(self._in_use.names)} is NOT stored so ({error}): do not use it"
                " before you have lowered it by hand, or calibrated again"
            )
        else:
            names = " and ".join(self._in_use.lower_names) or "nothing"
            self._tell_taken_down(f"{names} is stored so")

    def _tell_taken_down(self, what_is_stored: str) -> None:
        said = said_of_whole(self._before, self._whole)
        if said is not None:
            print(f"{said}: {what_is_stored}", file=sys.stderr, flush=True)

    @property
    def trials(self) -> str | None:
        """The file that they are in, if there were any."""
        return self._trials.name

    @property
    def saved_in(self) -> str:
        """Of this nothing is saved on the way."""
        return ""

    @property
    def kept(self) -> str:
        """What is kept, and how to continue."""
        return "nothing that was asked is kept: the same command begins again, after a rest"

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr if self._args.json else sys.stdout, flush=True)


def _not_as_calibrated(why: str) -> FileError:
    return FileError("the calibration", "electrode", why, "let the skin rest, and calibrate again")
