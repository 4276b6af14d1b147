"""The screen during a calibration: the array, the progress, and the keys.

Owns: the printed lines, and redrawing them on a terminal. Must not know: procedures, the meanings
of keys, daemons. Currents are never shown: they could influence the answers. If the result is
printed as JSON (`is_quiet`), only the progress is printed, to standard error.
"""

from __future__ import annotations

import sys

from etd.apps.picture import Picture
from etd.calibrate.answers import Answer, Ask, Question
from etd.calibrate.progress import Progress
from etd.cli.keys import legend
from etd.cli.terminal import is_terminal
from etd.protocol.facts import ArrayFacts

_CLEAR = "\x1b[H\x1b[2J"
_ASKED = {
    "strength": "How strong was it?",
    "compare": "Was the second as strong as the first?",
    "which": "Which one was too strong?",
}


class Screen:
    """`progress` is read, never changed."""

    def __init__(self, array: ArrayFacts, progress: Progress, is_quiet: bool) -> None:
        self._picture = Picture(array.x_mm, array.y_mm)
        self._progress = progress
        self._is_quiet = is_quiet
        self._electrode: int | None = None
        self._ask: Ask | None = None

    def begin(self) -> None:
        """Before the first question, during the soft start."""
        where = sys.stderr if self._is_quiet else sys.stdout
        print(to_come(self._progress), file=where, flush=True)

    def ask(self, question: Question) -> None:
        """Print the question, and the picture when the electrode has changed."""
        self._ask = question.ask
        if self._is_quiet:
            return
        if is_terminal() or question.electrode != self._electrode:
            self._electrode = question.electrode
            above = [_CLEAR] if is_terminal() else []
            print("\n".join([*above, *self.rows(), self.line()]))
        print(f"{_ASKED[question.ask]}   {legend(question.ask)}", flush=True)

    def heard(self, answer: Answer | None) -> None:
        """After each key: confirm it, and say whether another presentation follows."""
        if self._is_quiet:
            return
        if answer is None:
            print("   this key is not one of the answers", flush=True)
        elif answer not in ("stop", "pause"):
            ends = answer in ("first", "both") or (self._ask, answer) == ("compare", "too_strong")
            follows = "" if ends else "; next presentation"
            print(f"   {answer.replace('_', ' ')}{follows}", flush=True)

    def found(self) -> None:
        """After an electrode: print a line, unless the screen is redrawn."""
        if self._is_quiet:
            print(count_of(self._progress), file=sys.stderr, flush=True)
        elif not is_terminal():
            print(self.line(), flush=True)

    def rows(self) -> list[str]:
        """The array as text; `line` explains the signs."""
        return self._picture.rows(
            [self._sign(electrode) for electrode in range(self._progress.conditions.electrodes)]
        )

    def line(self) -> str:
        return f"{count_of(self._progress)}   (@ now, # done, x not felt, ! too strong, . to do)"

    def _sign(self, electrode: int) -> str:
        if electrode in self._progress.found:
            return "#" if self._progress.found[electrode].felt else "x"
        if electrode == self._electrode:
            return "@"
        return "!" if electrode in self._progress.lowered_ua else "."


def to_come(progress: Progress) -> str:
    return (
        f"method {progress.conditions.method}: {len(progress.missing)} electrodes to do, at least"
        " half a minute each"
    )


def count_of(progress: Progress) -> str:
    done, all_of_them = len(progress.found), progress.conditions.electrodes
    return f"{done} of {all_of_them} electrodes, {progress.presentations} presentations"
