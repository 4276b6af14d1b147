"""The operator of a fake board, who follows every instruction at once.

Owns: how long a press lasts, and which electrodes the resistor is on. Must not know: the test.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from etd_body.electrode import Contact, grounded, load
from etd_hal.bench import StopName
from etd_hal.fake.world import World
from etd_hal.ports import Clock

_REACTS_NS = 100_000_000
_PRESSES_NS = 200_000_000


class FakeOperator:
    """See `bench.Operator`. `really_ohm`: true values of resistors that are not as named."""

    def __init__(
        self, world: World, clock: Clock, really_ohm: Mapping[int, float] = MappingProxyType({})
    ) -> None:
        self._world = world
        self._clock = clock
        self._really_ohm = really_ohm
        self._on: tuple[int, ...] = ()

    def press(self, stop: StopName) -> None:
        pressed_ns = self._clock.now_ns() + _REACTS_NS
        self._world.press(stop, pressed_ns)
        self._world.release(stop, pressed_ns + _PRESSES_NS)

    def hold(self, stop: StopName) -> None:
        self._world.press(stop, self._clock.now_ns() + _REACTS_NS)

    def let_go(self, stop: StopName) -> None:
        self._world.release(stop, self._clock.now_ns() + _REACTS_NS)

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        """Half of the resistance at each electrode: the current passes through both."""
        self._put(load(self._really_ohm.get(load_ohm, load_ohm) / 2), first, second)

    def ground(self, load_ohm: int, electrode: int) -> None:
        self._put(grounded(self._really_ohm.get(load_ohm, load_ohm)), electrode)

    def _put(self, contact: Contact, *electrodes: int) -> None:
        for electrode in self._on:
            self._world.lift(electrode)
        self._on = electrodes
        for electrode in electrodes:
            self._world.touch(electrode, contact)

    def misplaced(self, asked: int, found: tuple[int, ...]) -> None:
        """It connects the load correctly."""

    def stand_back(self) -> None:
        """It never touches an electrode."""
