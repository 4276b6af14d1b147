"""A whole calibration: electrodes in random turn, until each has its three figures.

Owns: whose turn it is, when a trial is silent, and saving the progress after each electrode. Must
not know: presentations and questions (asking), procedures and bounds of an electrode (tasks), who
answers, where progress is stored.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from etd.calibrate.answers import Answer, Answerer, Ask, Presentation
from etd.calibrate.asking import Asking, Presenter
from etd.calibrate.conditions import check_baseline
from etd.calibrate.equal_strength import EqualTasks
from etd.calibrate.in_doubt import InDoubt
from etd.calibrate.order import CHECK_EACH, IN_PLAY, drawn, is_catch, shuffled
from etd.calibrate.progress import Progress
from etd.calibrate.reach import RISE
from etd.calibrate.stimulator import NotDelivered
from etd.calibrate.tasks import FitBounds, FitTasks, Task, Tasks, ThresholdTasks
from etd.calibrate.trial import BelowThreshold, Unsettled
from etd.protocol.calibration import Calibration, ElectrodeLimits

#: A threshold that has changed by more than this part is a reason for a rest.
MOST_DRIFT = 0.2
#: A step below a current is calculated two ways, each rounded.
_ROUNDED_UA = 1
#: The whole array begins at this part of all comfortable currents, and comes at most so often.
_WHOLE_FROM = 0.5
_MOST_WHOLE = 30


class Course:
    """`progress` is filled in; `on_progress` is called with it after each electrode, and at once
    when something was too strong. `on_presented` is called with each presentation, before the
    question about it, and `on_answered` with the question and the answer (None: something else
    ended it). `on_threshold` is called when an electrode's threshold is found, `on_found` when it
    has all figures. `on_drift` is called with a threshold's change, as a part of it, and whether it
    is at least so much, when that of the first electrode has changed so much, or is not felt any
    more up to its cap, that a rest is due. `asks_sensation`: ask of each felt
    electrode what it feels like, and where. `today` dates each electrode: a calibration may
    continue on another day.

    `fit`: thresholds alone, for an exponent (fitting), within these bounds. `last`: of a course
    that follows on another one, what that presented last, which a stop would be about.

    `baseline`: an earlier calibration of the same person, which gives the first currents; the
    method `equalize` takes over all of it except the comfortable levels.

    Raises, when made: Refused, PackageMissing.
    """

    def __init__(
        self,
        progress: Progress,
        presenter: Presenter,
        answerer: Answerer,
        today: Callable[[], datetime.date],
        *,
        baseline: Calibration | None = None,
        on_progress: Callable[[Progress], None] = lambda _: None,
        on_presented: Callable[[Presentation], None] = lambda _: None,
        on_answered: Callable[[Presentation, Ask, Answer | None], None] = lambda *_: None,
        on_threshold: Callable[[int], None] = lambda _: None,
        on_found: Callable[[int], None] = lambda _: None,
        on_drift: Callable[[float, bool], None] = lambda *_: None,
        asks_sensation: bool = False,
        fit: FitBounds | None = None,
        last: InDoubt | None = None,
    ) -> None:
        if baseline is not None:
            check_baseline(progress.conditions, baseline)
        self._progress = progress
        self._asking = Asking(
            progress, presenter, answerer, on_progress, on_presented, on_answered, last
        )
        self._tasks: Tasks
        if progress.conditions.method == "equalize":
            self._tasks = EqualTasks(progress, self._asking, baseline, today)
        elif fit is not None:
            self._tasks = FitTasks(progress, self._asking, baseline, today, on_threshold, fit)
        else:
            self._tasks = ThresholdTasks(progress, self._asking, baseline, today, on_threshold)
        self._is_known = baseline is not None
        self._on_progress = on_progress
        self._on_found = on_found
        self._on_drift = on_drift
        self._asks_sensation = asks_sensation
        self._waiting: list[int] = []
        self._check_each = CHECK_EACH
        self._in_play: dict[int, Task] = {}
        #: How many had figures when the first was asked again; after so many more it is once more.
        self._checked = 0
        #: What each of these feels like was asked in this run, whatever was answered.
        self._asked_sensation: set[int] = set()
        self.left: dict[int, str] = {}

    @property
    def last(self) -> InDoubt | None:
        """What a stop now would be about."""
        return self._asking.last

    def wait(self, until_ready: Callable[[], None]) -> None:
        """Before it runs: what it was stopped at is asked about first, and a stop meanwhile is
        about what was presented last. Raises: Stopped, Refused, DaemonGone.
        """
        self._asking.settle_doubt()
        self._asking.wait(until_ready)

    def run(self, electrodes: Sequence[int]) -> Progress:
        """Calibrate those that have no result yet. Those that still have none are in `left`, with
        the reason. Raises: Stopped, Refused, DaemonGone.
        """
        progress = self._progress
        self._asking.settle_doubt()
        wanted = set(electrodes) - set(progress.found)
        self._waiting = shuffled(progress.seed, progress.conditions.electrodes, wanted)
        self._in_play.clear()
        self._asked_sensation.clear()
        # A check that was cut off by a pause, or by a halt, is due still.
        self._checked = 0 if progress.drift is None else len(progress.found)
        self._check_each = min(CHECK_EACH, (len(wanted) + len(progress.found)) // 2)
        self._check_if_due()
        while True:
            if self._waiting and len(self._in_play) < self._most_in_play():
                self._attempt(self._waiting.pop(0), self._begin)
            elif self._in_play:
                self._attempt(
                    drawn(progress.seed, progress.presentations, self._in_play), self._trial
                )
            elif unasked := self._without_sensation():
                self._attempt(unasked[0], self._ask_sensation)
            else:
                return progress

    def feel_whole(self) -> None:
        """All felt electrodes at once, up to level 1: many together feel stronger than each, and
        the skin may have changed since. Too strong takes all levels down to the step before. When
        each electrode has its figures, and not again once it was accepted.

        Raises: Stopped, NotDelivered, Unsettled, Refused, DaemonGone.
        """
        progress = self._progress
        self._asking.settle_doubt()
        part, tries = _WHOLE_FROM, 0
        accepted_ua: dict[int, int] = {}
        while progress.is_whole_due:
            if (tries := tries + 1) > _MOST_WHOLE:
                raise Unsettled(_MOST_WHOLE)
            if self._asking.whole(part) == "too_strong":
                # The levels are a step below that now, and were presented: unless this was the
                # first step, or a level would have fallen below its threshold.
                part = _WHOLE_FROM
                progress.is_whole_accepted = bool(accepted_ua) and all(
                    current_ua <= accepted_ua[electrode] + _ROUNDED_UA
                    for electrode, current_ua in progress.level_1_ua.items()
                )
                # What was accepted before it was too strong counts for no later pass.
                accepted_ua = {}
            else:
                accepted_ua = progress.part_of_level_1(part)
                progress.is_whole_accepted = part >= 1.0
                part = min(1.0, part * RISE)
            self._on_progress(progress)

    def _most_in_play(self) -> int:
        """Without a baseline the first electrode comes alone: the others begin below what it found.
        So does each where there is no seed (order).
        """
        is_known = self._is_known or any(one.felt for one in self._progress.found.values())
        return IN_PLAY if is_known and self._progress.seed is not None else 1

    def _attempt(self, electrode: int, step: Callable[[int], None]) -> None:
        try:
            step(electrode)
        except (NotDelivered, Unsettled, BelowThreshold) as error:
            task = self._in_play.pop(electrode, None)
            if task is None or not task.is_check:
                self.left[electrode] = str(error)
            else:
                self._queue_if_taken_back(electrode)

    def _begin(self, electrode: int) -> None:
        self._asking.resistances.pop(electrode, None)
        self._in_play[electrode] = self._tasks.begin(electrode)
        self._settle(electrode)

    def _trial(self, electrode: int) -> None:
        progress, task = self._progress, self._in_play[electrode]
        if is_catch(progress.seed, progress.presentations):
            task.silent_trial()
            return
        task.trial()
        self._settle(electrode)

    def _settle(self, electrode: int) -> None:
        """Keep its figures, if it has them."""
        track = self._in_play[electrode].track
        if not track.is_over:
            return
        is_check = self._in_play.pop(electrode).is_check
        if is_check:
            self._compare(electrode, track.result)
            return
        progress = self._progress
        progress.keep(electrode, track.result)
        if track.result.felt:
            # All together were accepted without it.
            progress.is_whole_accepted = False
        self.left.pop(electrode, None)
        self._on_progress(progress)
        if self._asks_sensation and track.result.felt:
            self._ask_sensation(electrode)
        self._on_found(electrode)
        self._check_if_due()

    def _ask_sensation(self, electrode: int) -> None:
        """The figures are kept already, whatever is answered."""
        self._asked_sensation.add(electrode)
        found = self._progress.found[electrode]
        quality, place = self._asking.sensation(electrode, found.comfortable_ua)
        if electrode in self._progress.found:
            self._progress.found[electrode] = replace(found, quality=quality, place=place)
            self._on_progress(self._progress)
        else:
            self._asked_sensation.discard(electrode)
            self._queue_if_taken_back(electrode)

    def _without_sensation(self) -> list[int]:
        """Those that have their figures, and were not asked: a pause came first, or it was not
        wanted then.
        """
        if not self._asks_sensation:
            return []
        return [
            electrode
            for electrode, limits in self._progress.found.items()
            if limits.felt and limits.quality is None and electrode not in self._asked_sensation
        ]

    # --- drift -------------------------------------------------------------------------------

    def _check_if_due(self) -> None:
        """Ask the first electrode again, where others are left for which it matters: what has
        changed there, may have changed everywhere.
        """
        count = len(self._progress.found)
        is_one_left = bool(self._waiting) or any(not one.is_check for one in self._in_play.values())
        is_due = count > 0 and count - self._checked >= self._check_each
        if not is_one_left or not is_due or self._progress.seed is None:
            return
        first = next((one for one, limits in self._progress.found.items() if limits.felt), None)
        if first in self._in_play:
            return  # It is being asked already.
        self._checked = count
        if first is not None and (task := self._tasks.check(first)) is not None:
            self._in_play[first] = task

    def _compare(self, electrode: int, again: ElectrodeLimits) -> None:
        progress = self._progress
        before = progress.found.get(electrode)
        if before is None:
            self._queue_if_taken_back(electrode)
            return
        progress.drift = round(again.threshold_ua / before.threshold_ua - 1.0, 3)
        progress.is_drift_least = not again.felt
        self._on_progress(progress)
        if is_rest_due(progress.drift, is_least=progress.is_drift_least):
            self._on_drift(progress.drift, progress.is_drift_least)

    def _queue_if_taken_back(self, electrode: int) -> None:
        """What was too strong has taken its figures back: it needs others."""
        if electrode not in self._progress.found and electrode not in self._waiting:
            self._waiting.append(electrode)


def is_rest_due(drift: float, *, is_least: bool) -> bool:
    """`is_least`: it was not felt any more up to its cap, however near to its threshold that is."""
    return is_least or abs(drift) > MOST_DRIFT
