"""What a calibration's command presents on: arming it, the keys that stop it, and a stimulator.

Owns: who stops where the keys' input has ended, and which reports a stimulator goes by. Must not
know: what is asked, what the keys mean.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from etd.calibrate.answers import Answer, Question
from etd.calibrate.conditions import Conditions
from etd.calibrate.stimulator import Stimulator
from etd.cli.arming import ARM_WITHIN_S, armed_for
from etd.cli.keys import INPUT_CLOSED, Keyboard, keyboard
from etd.client import Display, clock


class Stage:
    """Of one session. `has_begun`: it is armed for it, so something may have been presented."""

    def __init__(self, args: argparse.Namespace, display: Display) -> None:
        self._display = display
        self._at_once = args.board is not None or args.arm
        self.has_begun = False

    def arm(self) -> None:
        """For simulated answers. Raises: Refused, DaemonGone."""
        self._display.arm(ARM_WITHIN_S)
        self.has_begun = True

    @contextmanager
    def armed_keys(
        self, show: Callable[[Question], None], heard: Callable[[Answer | None], None]
    ) -> Iterator[Keyboard]:
        """The person's, when it is armed. Raises: Stopped, Refused, DaemonGone; FileError, if there
        is no keyboard.
        """
        with keyboard(show, heard, lambda: self._display.stop(INPUT_CLOSED)) as keys:
            armed_for(self._display, keys, at_once=self._at_once)
            self.has_begun = True
            yield keys

    @contextmanager
    def stimulator(
        self,
        conditions: Conditions,
        wants_stop: Callable[[], bool],
        on_report: Callable[[object], None] = lambda _: None,
    ) -> Iterator[Stimulator]:
        """Not opened yet. Raises: Refused, DaemonGone."""
        display = self._display
        with display.telemetry("scan", "halt", "modelled", "state") as reports:
            yield Stimulator(
                display, reports, clock.ClientClock(), conditions, wants_stop, on_report
            )
