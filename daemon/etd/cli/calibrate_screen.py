"""The screen during a calibration: the array, the progress, and the keys.

Owns: the printed lines, of at most 80 columns, and redrawing them on a terminal. Must not know:
procedures, the meanings of keys, daemons. Currents can be left out (`is_blind`), since they could
influence who sees them and answers. If the result is printed as JSON (`is_quiet`), only the
progress is printed, to standard error.
"""

from __future__ import annotations

import sys

from etd.apps.picture import Picture
from etd.calibrate.answers import Answer, Ask, Presentation, Question
from etd.calibrate.progress import Progress
from etd.cli.keys import legend
from etd.cli.terminal import is_terminal
from etd.protocol.facts import ArrayFacts

_CLEAR = "\x1b[H\x1b[2J"
_SIGNS = "@ now   # done   x not felt   ! too strong   . to do"
_ASKED = {
    "strength": "How strong was it?",
    "sure": "Too strong. Was it so? t again, or what it was.",
    "compare": "Was the second as strong as the first?",
    "which": "Which one was too strong?",
    "whole": "How strong was all of it together?",
    "in_use": "Is it as strong as at first?",
    "sure_in_use": "Too strong: it ends. Was it so? t again, or what it was.",
    "quality": "What does it feel like?",
    "place": "Where: under the electrode, around it, or elsewhere?",
    "stopped": "It was stopped at or after this one, the last time. How strong was it?",
    "stopped_which": "It was stopped at or after these, the last time. Which one was too strong?",
    "stopped_whole": "It was stopped at or after this, the last time. How strong was it?",
}
_ASKED_AGAIN = {
    "stopped": "Not too strong. Was it so? Once more what it was, or t: it comes again.",
    "stopped_which": "Which one was too strong? Once more: each that is named once counts.",
    "stopped_whole": "Not too strong. Was it so? Once more what it was, or t: it comes again.",
}
#: *Too strong* to these is asked no second time.
_AT_ONCE = ("sure", "sure_in_use", "stopped", "stopped_whole")


_IN_USE = "; in use again: SPACE STOPs it, other keys count when it asks"
_FOLLOWS = {"in_use": _IN_USE, "sure_in_use": _IN_USE}
#: With which question they are not on their way to level 1.
_WHOLE = {"in_use": ", in use", "sure_in_use": ", in use"}


class Screen:
    """`progress` is read, never changed."""

    def __init__(
        self,
        array: ArrayFacts,
        progress: Progress,
        is_quiet: bool,
        is_blind: bool = False,
        asked: int | None = None,
    ) -> None:
        """`asked`: so many electrodes, where it is not all of them."""
        self._picture = Picture(array.x_mm, array.y_mm)
        self._progress = progress
        self._asked = asked
        self._is_quiet = is_quiet
        self._is_blind = is_blind
        self._presented: Presentation | None = None
        self._electrode: int | None = None
        self._ask: Ask | None = None
        #: Whatever is not *too strong* is asked about once more.
        self._is_doubted = False
        self._advice = ""

    def begin(self, to_do: int) -> None:
        """Before the first question, during the soft start; `to_do`: so many electrodes."""
        where = sys.stderr if self._is_quiet else sys.stdout
        print(to_come(self._progress, to_do), file=where, flush=True)

    def presented(self, presented: Presentation) -> None:
        """Before the question about it."""
        self._presented = presented

    def ask(self, question: Question) -> None:
        """Print what was presented, the question, and the picture of another electrode."""
        self._ask = question.ask
        self._is_doubted = question.ask in _ASKED_AGAIN and not question.is_again
        if self._is_quiet:
            return
        if is_terminal() or question.electrode != self._electrode:
            self._electrode = question.electrode
            above = [_CLEAR] if is_terminal() else []
            print("\n".join([*above, *self.rows(), self.line(), _SIGNS]))
            if self._advice and is_terminal():
                print(self._advice)
        print(self._what(question))
        asked = _ASKED_AGAIN if question.is_again else _ASKED
        print(f"{asked[question.ask]}\n{legend(question.ask)}", flush=True)

    def heard(self, answer: Answer | None) -> None:
        """After each key: confirm it, and say whether another presentation follows."""
        if self._is_quiet:
            return
        if answer is None:
            print("   this key is not one of the answers", flush=True)
        elif answer not in ("stop", "pause"):
            is_asked_again = answer == "too_strong" and self._ask not in _AT_ONCE
            is_first_of_two = self._ask == "quality"
            ends = answer in ("first", "both", "neither") or is_asked_again or is_first_of_two
            ends = ends or (answer, self._ask) == ("too_strong", "sure_in_use")
            ends = ends or (self._is_doubted and answer != "too_strong")
            follows = "" if ends else _FOLLOWS.get(self._ask or "", "; next presentation")
            print(f"   {answer.replace('_', ' ')}{follows}", flush=True)

    def found(self) -> None:
        """After an electrode: print a line, unless the screen is redrawn."""
        if self._is_quiet:
            print(self.line(), file=sys.stderr, flush=True)
        elif not is_terminal():
            print(self.line(), flush=True)

    def advise(self, advice: str) -> None:
        """Stays on a screen that is redrawn; otherwise it is printed once."""
        self._advice = advice
        if self._is_quiet or not is_terminal():
            print(advice, file=sys.stderr, flush=True)

    def rows(self) -> list[str]:
        """The array as text; `line` explains the signs."""
        return self._picture.rows(
            [self._sign(electrode) for electrode in range(self._progress.conditions.electrodes)]
        )

    def line(self) -> str:
        return count_of(self._progress, self._asked)

    def _what(self, question: Question) -> str:
        """`electrode 12: 850 uA`, after what it is compared with."""
        shown, is_told = self._presented, not self._is_blind
        if (shown is not None and shown.is_whole) or question.ask == "stopped_whole":
            return "all electrodes at once" + _WHOLE.get(question.ask, ", up to level 1")
        one = _at(question.electrode, _told_ua(shown) if shown and is_told else None)
        if question.reference is None:
            return one
        before_ua = shown.reference_ua if shown and is_told else None
        other = _at(question.reference, before_ua)
        first, second = (one, other) if question.is_reference_last else (other, one)
        return f"first {first}, second {second}"

    def _sign(self, electrode: int) -> str:
        if electrode in self._progress.found:
            return "#" if self._progress.found[electrode].felt else "x"
        if electrode == self._electrode:
            return "@"
        return "!" if electrode in self._progress.lowered_ua else "."


def _told_ua(shown: Presentation) -> int:
    """A catch trial looks like the presentation that it stands for."""
    return shown.current_ua if shown.stands_for_ua is None else shown.stands_for_ua


def _at(electrode: int, current_ua: int | None) -> str:
    return f"electrode {electrode}" + ("" if current_ua is None else f": {current_ua} uA")


def to_come(progress: Progress, to_do: int) -> str:
    """Those that are left out are not to be done."""
    if not to_do:
        return f"method {progress.conditions.method}: every electrode asked for has a result"
    count = "1 electrode" if to_do == 1 else f"{to_do} electrodes"
    return f"method {progress.conditions.method}: {count} to do, at least half a minute each"


def count_of(progress: Progress, asked: int | None = None) -> str:
    """`asked`: so many electrodes, where it is not all of them."""
    done, all_of_them = len(progress.found), asked or progress.conditions.electrodes
    return f"{done} of {all_of_them} electrodes, {progress.presentations} presentations"
