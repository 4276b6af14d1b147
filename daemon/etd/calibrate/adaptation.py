"""Whether a person feels less and less in use, asked: all electrodes are in use at one strength for
minutes, and every now and then it is asked whether it is as strong as at first.

Owns: what is shown, when it is asked, and which answers count. Must not know: terminals, daemons,
what it is good for, when it lets answers raise (etd.protocol.adaptation).

Touch adapts to use (thresholds up by 60 to 270 % in a quarter of an hour: Kaczmarek 2000 [abs]),
and the skin changes meanwhile. Both weaken what is felt, so they are not told apart;
and it is asked as it is said later, of all together, since thresholds that are asked one after
another take minutes in which touch recovers. All are shown at a level that a picture might have,
once a second, after the finger has lain for a while and all together were brought up to level 1 as
at the end of a calibration. What is too strong, on the way there or later, takes all of them down.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from etd.calibrate.answers import Answer, Answerer, Ask, Presentation, Question
from etd.calibrate.asking import Presenter
from etd.calibrate.conditions import Conditions
from etd.calibrate.progress import Progress
from etd.calibrate.reach import RISE
from etd.calibrate.trial import Stopped, TooStrongSaid
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.calibration import Calibration, current_of_level
from etd.protocol.errors import EtdError

#: In use for so long, and asked so often meanwhile.
USE_S: Final = 600.0
QUESTIONS: Final = 40
#: Before that the finger lies still, for this part of it: most of the sweat comes then, which is
#: not what use does.
LIES_PART: Final = 0.5
#: Of a picture, and how often all of it comes.
USE_LEVEL: Final = 0.6
_EACH_S: Final = 1.0


class TooStrongInUse(EtdError):
    """A level that had been accepted was too strong after a while. Fields: used_s."""

    def __init__(self, used_s: float) -> None:
        self.used_s = used_s
        super().__init__(f"it was too strong after {used_s:.0f} s of use, so nothing was measured")


def before_use(conditions: Conditions, baseline: Calibration) -> Progress:
    """Of a course that brings the whole array up to level 1, before it is in use."""
    return Progress(conditions=conditions, found=dict(enumerate(baseline.electrode)))


def take_down_from_use(accepted: Progress, gamma: float) -> None:
    """What was in use was too strong: level 1 is a step below that now."""
    in_use_ua, level_1_ua = currents_in_use(accepted, gamma), accepted.level_1_ua
    accepted.take_down(RISE * max(level_1_ua[one] / ua for one, ua in in_use_ua.items()))
    accepted.is_whole_accepted = False


def take_down_on_the_way(whole: Progress, accepted: Presentation | None) -> None:
    """*Too strong* was said while it was brought up: of what is in doubt; or else of what was
    `accepted` just before, where that is so: its answer was given, and the word came after it.
    """
    times = None
    if whole.in_doubt is not None:
        times = whole.in_doubt.times
    elif accepted is not None:
        times = RISE * whole.level_1_ua[accepted.electrode] / accepted.current_ua
    if times is not None:
        whole.take_down(times)
        whole.is_whole_accepted = False


def currents_in_use(accepted: Progress, gamma: float) -> dict[int, int]:
    """In uA, by electrode that has a level 1: of the levels that were accepted of all together."""
    return {
        electrode: max(1, current_of_level(accepted.found[electrode], USE_LEVEL, gamma))
        for electrode in accepted.level_1_ua
    }


def in_use(
    presenter: Presenter,
    answerer: Answerer,
    currents_ua: Mapping[int, int],
    use_s: float,
    now_s: Callable[[], float],
    on_presented: Callable[[Presentation], None] = lambda _: None,
    on_answered: Callable[[Presentation, Ask, Answer | None], None] = lambda *_: None,
    on_too_strong: Callable[[], None] = lambda: None,
    on_slip: Callable[[], None] = lambda: None,
) -> list[Answer]:
    """All answers, in their order: `QUESTIONS` of them, alike over `use_s`. Time in which a
    question stands is not use. `on_too_strong`: called at once when it was, before it is asked
    whether that was so, since the process may be gone before that is answered; and where a word
    that answers nothing says it, which ends this. `on_slip`: it was not.

    Raises: TooStrongInUse, Stopped, NotDelivered, Refused, DaemonGone.
    """
    answers: list[Answer] = []
    for number in range(QUESTIONS):
        try:
            last = _used(presenter, currents_ua, use_s / QUESTIONS, now_s)
            on_presented(last)
            answer = _answered(presenter, answerer, last, "in_use", on_answered)
        except TooStrongSaid:
            on_too_strong()
            raise
        if answer == "too_strong":
            used_s = (number + 1) * use_s / QUESTIONS
            # Keys slip; nothing is shown until it is certain. It may never be: who is in pain ends
            # it, or the daemon is gone.
            on_too_strong()
            answer = _answered(presenter, answerer, last, "sure_in_use", on_answered)
            if answer == "too_strong":
                raise TooStrongInUse(used_s)
            on_slip()
        answers.append(answer)
    return answers


def _answered(
    presenter: Presenter,
    answerer: Answerer,
    last: Presentation,
    ask: Ask,
    on_answered: Callable[[Presentation, Ask, Answer | None], None],
) -> Answer:
    """Raises: Stopped, and what the daemon refuses meanwhile."""
    try:
        answer = answerer.answer(Question(ask, last.electrode), presenter.keep)
    except BaseException:
        on_answered(last, ask, None)
        raise
    if answer == "stop":
        presenter.stop()
    on_answered(last, ask, answer)
    if answer in ("stop", "pause"):
        raise Stopped(answer)
    return answer


def _used(
    presenter: Presenter,
    currents_ua: Mapping[int, int],
    seconds: float,
    now_s: Callable[[], float],
) -> Presentation:
    """All of it once a second, for so long; the last time."""
    until_s = now_s() + seconds
    while True:
        begun_s = now_s()
        delivered = presenter.present_whole(currents_ua)
        rest_s = min(begun_s + _EACH_S, until_s) - now_s()
        if rest_s > 0.0:
            presenter.pause(rest_s)
        if now_s() >= until_s:
            electrode = delivered.electrode
            return Presentation(
                electrode,
                currents_ua[electrode],
                delivered.current_ua,
                delivered.begun_ns,
                is_whole=True,
                rate_hz=delivered.rate_hz,
            )


def adaptation_of(
    answers: Sequence[Answer], use_s: float, today: datetime.date
) -> MeasuredAdaptation:
    """By the second half of them, and since when. Whether it lets answers raise, it says itself."""
    later = answers[len(answers) // 2 :]
    return MeasuredAdaptation(
        answers=len(later),
        weaker=later.count("weaker"),
        stronger=later.count("stronger"),
        use_s=use_s,
        weaker_from_s=_weaker_from(answers) * use_s / len(answers),
        date=today,
    )


def _weaker_from(answers: Sequence[Answer]) -> int:
    """Which is the first *weaker*, from 1 on, if each before it that is one, and each after it that
    is none, is an error: where these are the fewest; of several, the last, which is one more than
    there are if none is.
    """
    weaker = [answer == "weaker" for answer in answers]

    def errors(first: int) -> int:
        return sum(weaker[:first]) + weaker[first:].count(False)

    return 1 + min(range(len(weaker), -1, -1), key=errors)
