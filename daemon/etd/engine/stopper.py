"""Whether the stopper is alive, and whether it has acted; the engine's own sign of life; and the
stopper as a thread.

Owns: the judgement of its last check, as the scan thread makes it at each poll; what it is told of
the supply, and what it has noted of that. Must not know: states, frames, when a message is overdue
(`etd_hal.stopper`).
"""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable

from etd_hal.cutlatch import (
    ALIVE_NS,
    CAUSE,
    CUTS,
    LOOKED_NS,
    NOTE_ERROR,
    NOTED,
    POWER,
    SILENT,
    WINDOW_NS,
    CutLatch,
)
from etd_hal.stopper import PERIOD_NS, Stopper
from etd_hal.supply_note import SupplyNote

#: A stopper without a check for so long has ended or hangs: it normally checks a thousand times in
#: this. A scan may go on that long without it; a busy machine can keep a process from its processor
#: for tenths of a second, and that is no fault of the board.
SILENT_NS = 500_000_000
#: Of the time between two calls of `judge`, which come every few milliseconds, at most so much
#: counts: while everything was stopped, the stopper was not silent.
_COUNTED_NS = 10_000_000
#: A thread that has begun says so within this time.
_BEGUN_WITHIN_S = 2.0


class StopperLiveness:
    """The time without a check of the stopper, and its cuts, as the scan thread sees them."""

    def __init__(
        self, latch: CutLatch, note: SupplyNote | None = None, *, most_silent_ns: int = SILENT_NS
    ) -> None:
        """`note`: what the stopper keeps. `most_silent_ns`: longer for a fake board alone, whose
        stopper is a thread that waits for a processor with everything else on the machine.
        """
        self._most_silent_ns = most_silent_ns
        self._words = latch.words
        self._note = note
        #: Why there is none that may be kept.
        self._refusal: str | None = None
        #: So many cuts have led to a halt that was cleared.
        self._cleared = 0
        self._begun_ns = 0
        self._looked_ns = 0
        self._judged_ns = 0
        #: As judged last.
        self.silent_ns = 0

    @property
    def has_acted(self) -> bool:
        """Since the last `clear`: it has cut the outputs off."""
        return self._words[CUTS] != self._cleared

    def clear(self) -> None:
        """The halt that its cuts led to was cleared, and with it what the last engine left."""
        self._cleared = self._words[CUTS]
        self._words[POWER] += 2 - (self._words[POWER] & 1)

    @property
    def why_acted(self) -> str:
        """What its cut was for."""
        if self._words[CAUSE] == SILENT:
            window_ms = self._words[WINDOW_NS] // 1_000_000
            return (
                f"the engine made no poll for more than {window_ms} ms while the supply was on;"
                " outputs and supply were cut off"
            )
        return "an SPI message was overdue; its outputs were cut off"

    # --- the supply --------------------------------------------------------------------------

    @property
    def left(self) -> str | None:
        """What the last engine left, as a clause; None if it ended well."""
        return None if self._note is None else self._note.left()

    def refuse_note(self, why: str) -> None:
        """Its folder is not the engine's alone: who may write there could hide a crash."""
        self._refusal = why

    def try_note(self) -> None:
        """At the start, so that `note_problem` is known before the first arming. The trial leaves
        no note: to the next engine it would be a crash.
        """
        if self._note is None:
            return
        try:
            self._note.try_to_keep()
        except OSError as error:
            self._words[NOTE_ERROR] = error.errno or errno.EIO

    def supply_rises(self) -> None:
        """Told before it is on: from now on the engine must be heard, and a note is kept."""
        self._words[POWER] += 1 + (self._words[POWER] & 1)

    def made_safe(self, problems: tuple[str, ...]) -> None:
        """Unless there were problems, nothing is left to be remembered of this power-up."""
        if self.is_supply_told and not problems:
            self._words[POWER] += 1

    @property
    def is_supply_told(self) -> bool:
        """From before the supply goes on until the board has been made safe."""
        return bool(self._words[POWER] & 1)

    def note_defect(self) -> None:
        """Once the stopper has ended, so that nothing else writes the note. Raises: OSError."""
        if self._note is not None:
            self._note.keep_as_defect()

    @property
    def has_noted(self) -> bool:
        """Whether all that it was told of the supply is on the disk, or cannot be."""
        return self._words[NOTED] == self._words[POWER]

    @property
    def note_problem(self) -> str | None:
        """Why arming is refused: a crash could not be remembered."""
        if self._refusal is not None:
            return f"that the supply is on cannot be noted: {self._refusal}"
        error = self._words[NOTE_ERROR]
        if not error:
            return None
        where = "" if self._note is None else f" in {self._note.path}"
        return (
            f"that the supply is on cannot be noted{where} ({os.strerror(error)}), so a crash would"
            " not be remembered: let the engine's user write there, or name another folder with"
            " --state"
        )

    def begin(self, now_ns: int) -> None:
        """The stopper has just been woken: an earlier check is no sign of life."""
        self._begun_ns = self._judged_ns = now_ns
        self.silent_ns = 0

    @property
    def has_looked(self) -> bool:
        """Whether the stopper has checked since `begin`."""
        return self._words[LOOKED_NS] >= self._begun_ns

    def judge(self, now_ns: int) -> bool:
        """Called at each poll of the scan thread. True: the stopper was silent for too long, or has
        acted. It is the engine's sign of life too.
        """
        self._words[ALIVE_NS] = now_ns
        looked_ns, since_ns = self._words[LOOKED_NS], now_ns - self._judged_ns
        self._judged_ns = now_ns
        if looked_ns != self._looked_ns:
            self._looked_ns = looked_ns
            self.silent_ns = 0
        else:
            self.silent_ns += since_ns if since_ns < _COUNTED_NS else _COUNTED_NS
        return self.silent_ns > self._most_silent_ns or self._words[CUTS] != self._cleared

    @property
    def problem(self) -> str | None:
        """What is wrong with a stopper that has stopped checking; None while it checks."""
        if self.silent_ns <= self._most_silent_ns:
            return None
        return (
            f"the stopper made no check for {self.silent_ns // 1_000_000} ms, it has ended or"
            " hangs: restart the daemon (one with a fake board, on a busy machine: with a greater"
            " --timeout-factor)"
        )


class StopperThread(threading.Thread):
    """The stopper of a board whose ports are in this process: a fake one's. Checks twice a
    millisecond while the supply is on, else waits.
    """

    def __init__(self, stopper: Stopper, prepare: Callable[[], str | None] = lambda: None) -> None:
        """`prepare` is called in the thread first, to give it a higher priority than the thread it
        watches; it returns a sentence if that was not granted.
        """
        super().__init__(name="etd-stopper", daemon=True)
        self._stopper = stopper
        self._prepare = prepare
        self._refusal: str | None = None
        self._has_begun = threading.Event()
        self._told = threading.Event()
        self._is_needed = False
        self._is_ending = False

    @property
    def refusals(self) -> tuple[str, ...]:
        """What was not granted, a sentence each."""
        self._has_begun.wait(_BEGUN_WITHIN_S)
        return () if self._refusal is None else (self._refusal,)

    def watch(self, is_needed: bool) -> None:
        self._is_needed = is_needed
        self._told.set()

    def run(self) -> None:
        self._refusal = self._prepare()
        self._has_begun.set()
        while not self._is_ending:
            self._told.wait(PERIOD_NS / 1e9 if self._is_needed else None)
            self._told.clear()
            self._stopper.check()

    def end(self) -> None:
        """Idempotent."""
        self._is_ending = True
        self._told.set()
        self.join(timeout=2.0)
