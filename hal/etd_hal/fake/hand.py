"""The hand at a fake board: it presses at once what is asked for, and moves a resistor about.

Owns: how long a press lasts, and which electrodes the resistor was on. Must not know: who asks.
"""

from __future__ import annotations

from etd_body.electrode import load
from etd_hal.bench import StopName
from etd_hal.fake.world import World
from etd_hal.ports import Clock

_REACTS_NS = 100_000_000
_PRESSES_NS = 200_000_000


class FakeHand:
    """See `bench.Hand`. `load_ohm` None: there is no resistor to be moved."""

    def __init__(self, world: World, clock: Clock, load_ohm: float | None) -> None:
        self._world = world
        self._clock = clock
        self._load_ohm = load_ohm
        self._on: tuple[int, ...] = ()

    def press(self, stop: StopName) -> None:
        pressed_ns = self._clock.now_ns() + _REACTS_NS
        self._world.press(stop, pressed_ns)
        self._world.release(stop, pressed_ns + _PRESSES_NS)

    def hold(self, stop: StopName) -> None:
        self._world.press(stop, self._clock.now_ns() + _REACTS_NS)

    def let_go(self, stop: StopName) -> None:
        self._world.release(stop, self._clock.now_ns() + _REACTS_NS)

    def clip(self, first: int, second: int) -> None:
        """Half of the resistance at each of the two: what flows in at one leaves by the other."""
        if self._load_ohm is None:
            return
        for electrode in self._on:
            self._world.lift(electrode)
        self._on = (first, second)
        for electrode in self._on:
            self._world.touch(electrode, load(self._load_ohm / 2))

    def stand_back(self) -> None:
        """It never touches an electrode."""
