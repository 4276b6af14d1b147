"""One presentation and its question.

Owns: the pauses, the question which of two was too strong, and that what was too strong is in the
progress before anything else happens. Must not know: procedures, the order of electrodes, how a
current is presented, who answers, where progress is stored.
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

#: Before each presentation, in turn: without a rhythm that answers could follow.
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
    """`on_progress` is called with `progress` at once when something was too strong, `on_presented`
    with the electrode of each presentation.
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
        #: Of the present electrode, by current; the caller empties it before another electrode.
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
        """Present the reference, then the electrode. `too_strong` refers to the electrode.

        Raises: Stopped, NotDelivered, Refused (`bad_calibration`: the reference was too strong).
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
        """Both count as too strong until the answer says which: it may never come."""
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
    """No electrode may be made as strong as it."""
    return Refused(
        "bad_calibration",
        f"the reference, electrode {reference}, is too strong at its comfortable level of the"
        " baseline: make a new calibration, or start again (--restart) with another --reference",
        reference,
    )
