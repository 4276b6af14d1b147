"""One presentation and its question.

Owns: the pauses, the second question after `too strong`, that what was too strong is in the
progress before anything else happens, and that what it was stopped at is asked about before
anything else is presented. Must not know: which presentation a stop is about (doubting),
procedures, the order of electrodes, how a current is presented, who answers, where progress is
stored.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from typing import Protocol, TypeAlias, get_args

from etd.calibrate.answers import Answer, Answerer, Ask, Presentation, Question, turned
from etd.calibrate.doubting import Doubting
from etd.calibrate.in_doubt import InDoubt
from etd.calibrate.order import is_reference_last, is_silence_first
from etd.calibrate.progress import Progress
from etd.calibrate.reach import RISE, Reach, a_step_below
from etd.calibrate.stimulator import Delivered
from etd.calibrate.trial import Stopped
from etd.protocol.calibration import ElectrodeLimits, Place, Quality
from etd.protocol.errors import Refused

#: Before each presentation, in turn: without a rhythm that answers could follow.
_PAUSES_S = (0.4, 0.6, 0.3, 0.5)
#: Between reference and comparison.
_BETWEEN_S = 0.4


Sensation: TypeAlias = tuple[Quality | None, Place | None]
#: What was found, the lowered caps, those of all at once, and what a stop would be about.
_Kept: TypeAlias = tuple[
    dict[int, ElectrodeLimits], dict[int, int], dict[int, tuple[int, int]], InDoubt | None
]


class Presenter(Protocol):
    """What is needed of a `Stimulator`."""

    def present(self, electrode: int, current_ua: int) -> Delivered: ...

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        """Of all these electrodes at once. What is delivered is that of the highest current."""
        ...

    def silence(self, electrode: int) -> Delivered:
        """Nothing, for as long as a presentation there takes."""
        ...

    def pause(self, seconds: float) -> None: ...

    def keep(self) -> None: ...

    def stop(self) -> None: ...


class Asking:
    """`on_progress` is called with `progress` at once when something was too strong, `on_presented`
    with each presentation, `on_answered` with what was asked about it and the answer: None if it
    was not answered, because something else ended it. `last`: as in `Doubting`.
    """

    def __init__(
        self,
        progress: Progress,
        presenter: Presenter,
        answerer: Answerer,
        on_progress: Callable[[Progress], None],
        on_presented: Callable[[Presentation], None],
        on_answered: Callable[[Presentation, Ask, Answer | None], None],
        last: InDoubt | None = None,
    ) -> None:
        self._progress = progress
        self._presenter = presenter
        self._answerer = answerer
        self._on_progress = on_progress
        self._on_presented = on_presented
        self._on_answered = on_answered
        self._doubting = Doubting(progress, on_progress, last)
        #: By electrode and current: the last one measured.
        self.resistances: dict[int, dict[int, int]] = {}
        self._comparisons: dict[int, int] = {}

    def strength(self, electrode: int, reach: Reach, current_ua: int) -> Answer:
        """Raises: Stopped, NotDelivered."""
        self._pause()
        left_ua = {electrode: reach.left_below(current_ua)}
        doubt = InDoubt(electrode=electrode, left_ua=left_ua)
        with self._doubting.presented(doubt):
            presented = self._present(electrode, current_ua)
        return self._strength_of(presented, lambda: self._lower(left_ua))

    def catch(self, electrode: int, stands_for_ua: int) -> None:
        """A silent trial, and the same question. Nothing was presented, so nothing is lowered; a
        stop is about what came before it.

        Raises: Stopped.
        """
        self._pause()
        progress = self._progress
        with self._doubting.after():
            begun_ns = self._presenter.silence(electrode).begun_ns
            progress.presentations += 1
            presented = Presentation(electrode, 0, 0, begun_ns, stands_for_ua=stands_for_ua)
            self._on_presented(presented)
            answer = self._strength_of(presented, lambda: None)
        progress.catch_trials += 1
        progress.false_alarms += answer != "not_felt"

    def catch_compared(
        self, electrode: int, stands_for_ua: int, reference: int, reference_ua: int
    ) -> None:
        """The reference, and silence in the electrode's place: any answer is a false alarm but that
        the silence was weaker. Of the two only the reference can have been too strong.

        Raises: Stopped, NotDelivered, Refused (`bad_calibration`: the reference was too strong).
        """
        self._pause()
        progress, presenter = self._progress, self._presenter
        is_last = is_silence_first(progress.seed, progress.presentations)
        doubt = InDoubt(
            electrode=electrode,
            reference=reference,
            is_reference_last=is_last,
            left_ua={reference: a_step_below(reference_ua)},
        )
        with self._doubting.presented(doubt):
            if is_last:
                presenter.silence(electrode)
                presenter.pause(_BETWEEN_S)
                begun_ns = self._deliver(reference, reference_ua).begun_ns
            else:
                self._deliver(reference, reference_ua)
                presenter.pause(_BETWEEN_S)
                begun_ns = presenter.silence(electrode).begun_ns
        progress.presentations += 1
        presented = Presentation(
            electrode=electrode,
            current_ua=0,
            commanded_ua=0,
            begun_ns=begun_ns,
            reference=reference,
            reference_ua=reference_ua,
            is_reference_last=is_last,
            stands_for_ua=stands_for_ua,
        )
        self._on_presented(presented)
        answer = self._compared(presented, reference, doubt.left_ua)
        progress.catch_trials += 1
        progress.false_alarms += answer != "weaker"

    def sensation(self, electrode: int, comfortable_ua: int) -> Sensation:
        """What the comfortable level feels like, and where; asked again where `too_strong` was a
        slip. None: too strong, which is kept. Raises: Stopped, NotDelivered.
        """
        self._pause()
        left_ua = {electrode: a_step_below(comfortable_ua)}
        doubt = InDoubt(electrode=electrode, left_ua=left_ua)
        with self._doubting.presented(doubt):
            presented = self._present(electrode, comfortable_ua)
        quality: Answer = "not_felt"
        while quality not in get_args(Quality):
            quality = self._strength_of(presented, lambda: self._lower(left_ua), "quality")
            if quality == "too_strong":
                return None, None
        with self._doubting.asked():
            place = self._answered(Question("place", electrode), presented)
        return (
            next((one for one in get_args(Quality) if one == quality), None),
            next((one for one in get_args(Place) if one == place), None),
        )

    def whole(self, part: float) -> Answer:
        """All at once at this part of level 1, and how that was. Too strong takes all levels down
        to a step below it.

        Raises: Stopped, NotDelivered.
        """
        self._pause()
        currents_ua = self._progress.part_of_level_1(part)
        highest = max(currents_ua, key=currents_ua.__getitem__)
        left_ua = self._progress.left_by(RISE / part)
        doubt = InDoubt(electrode=highest, times=RISE / part, together_ua=left_ua)
        with self._doubting.presented(doubt):
            delivered = self._presenter.present_whole(currents_ua)
        self._progress.presentations += 1
        electrode = delivered.electrode
        presented = Presentation(
            electrode,
            currents_ua[electrode],
            delivered.current_ua,
            delivered.begun_ns,
            is_whole=True,
            rate_hz=delivered.rate_hz,
        )
        self._on_presented(presented)
        return self._strength_of(presented, lambda: self._take_down(left_ua), "whole")

    def _take_down(self, left_ua: Mapping[int, tuple[int, int]]) -> None:
        self._progress.take_down_to(left_ua)
        self._kept_too_strong()

    def compared(
        self, electrode: int, reach: Reach, current_ua: int, reference: int, reference_ua: int
    ) -> Answer:
        """Present the reference and the electrode, in the order that is due; the answer is what the
        electrode is to the reference. `too_strong` refers to the electrode.

        Raises: Stopped, NotDelivered, Refused (`bad_calibration`: the reference was too strong).
        """
        self._pause()
        done = self._comparisons.get(electrode, 0)
        self._comparisons[electrode] = done + 1
        is_last = is_reference_last(self._progress.seed, electrode, done)
        doubt = InDoubt(
            electrode=electrode,
            reference=reference,
            is_reference_last=is_last,
            left_ua={
                reference: a_step_below(reference_ua),
                electrode: reach.left_below(current_ua),
            },
        )
        with self._doubting.presented(doubt):
            if not is_last:
                self._deliver(reference, reference_ua)
                self._presenter.pause(_BETWEEN_S)
            presented = self._present(electrode, current_ua, reference, reference_ua, is_last)
        return self._compared(presented, reference, doubt.left_ua)

    def _compared(self, presented: Presentation, reference: int, left_ua: dict[int, int]) -> Answer:
        """Until the answer is not taken back. Raises: Stopped, Refused."""
        is_last = presented.is_reference_last
        question = Question("compare", presented.electrode, reference, is_last)
        while True:
            before = self._kept()
            with self._doubting.asked():
                answer = self._answered(question, presented, lambda: self._lower(left_ua))
            if answer != "too_strong":
                return turned(answer) if is_last else answer
            if self._keep_which(presented, reference, left_ua, before):
                return answer

    def _keep_which(
        self,
        presented: Presentation,
        reference: int,
        left_ua: dict[int, int],
        before: _Kept,
    ) -> bool:
        """Both count as too strong until the answer says which: it may never come. What is not in
        `left_ua` was silent, and is not lowered. False: neither.

        Raises: Refused.
        """
        electrode, is_last = presented.electrode, presented.is_reference_last
        which = self._answered(Question("which", electrode, reference, is_last), presented)
        if is_last:
            which = turned(which)
        if which == "neither":
            self._take_back(before)
            return False
        if which in ("first", "second"):
            self._take_back(before)
            too_strong = reference if which == "first" else electrode
            self._lower({one: ua for one, ua in left_ua.items() if one == too_strong})
        if which != "second":
            raise too_strong_reference(reference)
        return True

    def _strength_of(
        self, presented: Presentation, lower: Callable[[], None], ask: Ask = "strength"
    ) -> Answer:
        """It counts as too strong until the second answer says otherwise: it may never come."""
        before = self._kept()
        with nullcontext() if presented.is_catch else self._doubting.asked():
            answer = self._answered(Question(ask, presented.electrode), presented, lower)
        if answer != "too_strong":
            return answer
        answer = self._answered(Question("sure", presented.electrode), presented)
        if answer != "too_strong":
            self._take_back(before)
        return answer

    def _kept(self) -> _Kept:
        progress = self._progress
        found, lowered_ua = dict(progress.found), dict(progress.lowered_ua)
        return found, lowered_ua, dict(progress.together_ua), self._doubting.last

    def _take_back(self, before: _Kept) -> None:
        """What was answered is no doubt, but a stop may be about it still."""
        found, lowered_ua, together_ua, self._doubting.last = before
        progress = self._progress
        progress.found, progress.lowered_ua = dict(found), dict(lowered_ua)
        progress.together_ua = dict(together_ua)
        self._on_progress(progress)

    def _lower(self, left_ua: dict[int, int]) -> None:
        for electrode, one_ua in left_ua.items():
            self._progress.lower(electrode, one_ua)
        self._kept_too_strong()

    def _kept_too_strong(self) -> None:
        """It needs no second question."""
        self._doubting.last = self._progress.in_doubt = None
        self._on_progress(self._progress)

    @property
    def last(self) -> InDoubt | None:
        """What a stop now would be about."""
        return self._doubting.last

    def wait(self, until_ready: Callable[[], None]) -> None:
        """Nothing is presented meanwhile: a stop is about what came before it."""
        with self._doubting.after():
            until_ready()

    # --- what it was stopped at ----------------------------------------------------------------

    def settle_doubt(self) -> None:
        """Before anything is presented: whether that was too strong which it was stopped at. What
        is said not to have been comes again, so that is asked twice: keys slip.

        Raises: Stopped, Refused (`bad_calibration`: the reference was too strong).
        """
        doubt = self._progress.in_doubt
        if doubt is None:
            return
        said = [self._answered_of_doubt(doubt.question)]
        if said[0] not in ("too_strong", "both"):
            said.append(self._answered_of_doubt(replace(doubt.question, is_again=True)))
        self._progress.in_doubt = None
        left_ua = {one: ua for answer in said for one, ua in doubt.left_by(answer).items()}
        if doubt.times is not None and "too_strong" in said:
            self._take_down(doubt.together_ua or self._progress.left_by(doubt.times))
        self._lower(left_ua)
        reference = self._progress.conditions.reference
        if reference is not None and reference in left_ua:
            raise too_strong_reference(reference)

    def _answered_of_doubt(self, question: Question) -> Answer:
        """Raises: Stopped."""
        answer = self._answerer.answer(question, self._presenter.keep)
        if answer == "stop":
            self._presenter.stop()
        if answer in ("stop", "pause"):
            raise Stopped(answer)
        return answer

    # --- one presentation --------------------------------------------------------------------

    def _pause(self) -> None:
        seconds = _PAUSES_S[self._progress.presentations % len(_PAUSES_S)]
        self.wait(lambda: self._presenter.pause(seconds))

    def _deliver(self, electrode: int, current_ua: int) -> Delivered:
        delivered = self._presenter.present(electrode, current_ua)
        self._doubting.is_fired = True
        return delivered

    def _present(
        self,
        electrode: int,
        current_ua: int,
        reference: int | None = None,
        reference_ua: int | None = None,
        is_reference_last: bool = False,
    ) -> Presentation:
        """The reference too, if it comes last."""
        delivered = last = self._deliver(electrode, current_ua)
        if is_reference_last and reference is not None and reference_ua is not None:
            self._presenter.pause(_BETWEEN_S)
            last = self._deliver(reference, reference_ua)
        self._progress.presentations += 1
        if delivered.resistance_ohm is not None:
            seen = self.resistances.setdefault(electrode, {})
            seen[current_ua] = delivered.resistance_ohm
        presented = Presentation(
            electrode=electrode,
            current_ua=current_ua,
            commanded_ua=delivered.current_ua,
            begun_ns=last.begun_ns,
            resistance_ohm=delivered.resistance_ohm,
            reference=reference,
            reference_ua=reference_ua,
            is_reference_last=is_reference_last,
        )
        self._on_presented(presented)
        return presented

    def _answered(
        self,
        question: Question,
        presented: Presentation,
        lower: Callable[[], None] = lambda: None,
    ) -> Answer:
        """`lower`: what is done where it was too strong. That, and a stop, come before the trial is
        told of. Raises: Stopped.
        """
        try:
            answer = self._answerer.answer(question, self._presenter.keep)
        except BaseException:
            self._on_answered(presented, question.ask, None)
            raise
        try:
            if answer == "stop":
                self._presenter.stop()
            elif answer == "too_strong":
                lower()
        finally:
            self._on_answered(presented, question.ask, answer)
        if answer in ("stop", "pause"):
            raise Stopped(answer)
        return answer


def too_strong_reference(reference: int) -> Refused:
    """No electrode may be made as strong as it."""
    return Refused(
        "bad_calibration",
        f"the reference, electrode {reference}, is too strong at its comfortable level of the"
        " baseline: make a new calibration, or start again (--restart) with another --reference",
        reference,
    )
