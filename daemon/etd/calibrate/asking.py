"""One presentation and its question: paused before, presented, answered, and kept where it hurt.

Owns: the pauses, what is asked when two were presented and one was too strong, and that what was
too strong is in the progress before anything else happens. Must not know: procedures, the order of
electrodes, how a current is presented, who answers, where progress is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from etd.calibrate.answers import Answer, Answerer, Question
from etd.calibrate.progress import Progress
from etd.calibrate.reach import Reach, a_step_below
from etd.calibrate.stimulator import Delivered
from etd.calibrate.trial import Stopped
from etd.protocol.errors import Refused

#: Before each presentation, in turn: a person should not answer to a rhythm.
_PAUSES_S = (0.4, 0.6, 0.3, 0.5)
#: Between reference and comparison.
_BETWEEN_S = 0.4


class Presenter(Protocol):
    """What is needed of a `Stimulator`."""

    def present(self, electrode: int, current_ua: int) -> Delivered: ...

    def pause(self, seconds: float) -> None: ...

    def keep(self) -> None: ...

    def stop(self) -> None: ...


class Asking:
    """`on_progress` hears of `progress` at once when something was too strong, `on_presented` the
    electrode of each presentation.
    """

    def __init__(
        self,
        progress: Progress,
        presenter: Presenter,
        answerer: Answerer,
        on_progress: Callable[[Progress], None],
        on_presented: Callable[[int], None],
    ) -> None:
        self._progress = progress
        self._presenter = presenter
        self._answerer = answerer
        self._on_progress = on_progress
        self._on_presented = on_presented
        #: Of the electrode that is asked about, by current; emptied by whoever begins another.
        self.resistances: dict[int, int] = {}

    def strength(self, electrode: int, reach: Reach, current_ua: int) -> Answer:
        """Raises: Stopped, NotDelivered."""
        self._pause()
        self._present(electrode, current_ua)
        answer = self._answered(Question("strength", electrode))
        if answer == "too_strong":
            self._lower({electrode: reach.left_below(current_ua)})
        return answer

    def compared(
        self, electrode: int, reach: Reach, current_ua: int, reference: int, reference_ua: int
    ) -> Answer:
        """The reference first. `too_strong` is of the second then: a reference that was ends it.

        Raises: Stopped, NotDelivered, Refused (`bad_calibration`).
        """
        self._pause()
        self._presenter.present(reference, reference_ua)
        self._presenter.pause(_BETWEEN_S)
        self._present(electrode, current_ua)
        answer = self._answered(Question("compare", electrode, reference))
        if answer == "too_strong":
            left_ua = {
                reference: a_step_below(reference_ua),
                electrode: reach.left_below(current_ua),
            }
            self._keep_which(electrode, reference, left_ua)
        return answer

    def _keep_which(self, electrode: int, reference: int, left_ua: dict[int, int]) -> None:
        """Until it is said which one it was, it was both: nobody may come to say it."""
        progress = self._progress
        found, lowered_ua = dict(progress.found), dict(progress.lowered_ua)
        self._lower(left_ua)
        which = self._answered(Question("which", electrode, reference))
        if which in ("first", "second"):
            progress.found, progress.lowered_ua = found, lowered_ua
            too_strong = reference if which == "first" else electrode
            self._lower({too_strong: left_ua[too_strong]})
        if which != "second":
            raise too_strong_reference(reference)

    def _lower(self, left_ua: dict[int, int]) -> None:
        for electrode, one_ua in left_ua.items():
            self._progress.lower(electrode, one_ua)
        self._on_progress(self._progress)

    # --- one presentation --------------------------------------------------------------------

    def _pause(self) -> None:
        self._presenter.pause(_PAUSES_S[self._progress.presentations % len(_PAUSES_S)])

    def _present(self, electrode: int, current_ua: int) -> None:
        delivered = self._presenter.present(electrode, current_ua)
        self._progress.presentations += 1
        if delivered.resistance_ohm is not None:
            self.resistances[current_ua] = delivered.resistance_ohm
        self._on_presented(electrode)

    def _answered(self, question: Question) -> Answer:
        """Raises: Stopped."""
        answer = self._answerer.answer(question, self._presenter.keep)
        if answer == "stop":
            self._presenter.stop()
        if answer in ("stop", "pause"):
            raise Stopped(answer)
        return answer


def too_strong_reference(reference: int) -> Refused:
    """Nothing is to be as strong as it any more."""
    return Refused(
        "bad_calibration",
        f"electrode {reference}, the reference, is too strong today at what was comfortable:"
        " calibrate anew, or begin anew with another --reference (--restart)",
        reference,
    )
