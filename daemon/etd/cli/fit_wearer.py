"""Who wears the array while a fit is asked: a person with keys, or the simulated one on the fake.

Owns: who answers, and how the skin comes into the next state. Must not know: the states, what is
asked, the fit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from etd.calibrate.answers import Answerer
from etd.calibrate.asking import Presenter
from etd.calibrate.modelled import FeltPresenter, ModelledBody
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.stimulator import Stimulator
from etd.calibrate.trial import Stopped
from etd.cli.keys import Keyboard

#: The fake's finger comes into its next state after a quarter of a minute without a pulse.
_SILENCE_S = 18.0
#: What begins a silence.
_NOT_FELT_UA = 100


class Wearer(Protocol):
    """`hear` gets every report of the daemon's."""

    answerer: Answerer

    def hear(self, report: object) -> None: ...

    def presenter(self, stimulator: Stimulator) -> Presenter: ...

    def come_into(self, state: int, stimulator: Stimulator) -> None:
        """Return when the skin is in this state, counted from 0. Raises: Stopped, Refused."""
        ...


class PersonAtKeys:
    """Implements `Wearer`."""

    def __init__(self, keys: Keyboard, say: Callable[[str], None]) -> None:
        self._keys = keys
        self._say = say
        self.answerer: Answerer = keys

    def hear(self, report: object) -> None:
        """The skin says by itself how a pulse felt."""

    def presenter(self, stimulator: Stimulator) -> Presenter:
        return stimulator

    def come_into(self, state: int, stimulator: Stimulator) -> None:  # noqa: ARG002 - they know it
        """When a key says so. The wearer's button and other programs are heard meanwhile."""
        self._say("Then any key   (SPACE STOP   q pause)")
        ending = self._keys.ready(stimulator.keep)
        if ending == "stop":
            stimulator.stop()
        if ending is not None:
            raise Stopped(ending)


class SimulatedWearer:
    """Implements `Wearer`: by what the body behind the fake reports."""

    def __init__(self, seed: int) -> None:
        self._body = ModelledBody()
        self._state = 0
        self.answerer: Answerer = SimulatedPerson(self._body.sense, seed)

    def hear(self, report: object) -> None:
        self._body.hear(report)

    def presenter(self, stimulator: Stimulator) -> Presenter:
        return FeltPresenter(stimulator, self._body)

    def come_into(self, state: int, stimulator: Stimulator) -> None:
        """A fake that was just started lies dry: of a fit that is continued, it goes through the
        states that are over.
        """
        while self._state < state:
            stimulator.present(0, _NOT_FELT_UA)
            stimulator.pause(_SILENCE_S)
            self._state += 1
