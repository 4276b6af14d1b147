"""A wire from SYNC to TRIGGER of a live fake board, as one tries the trigger without an instrument.

Owns: that an edge on SYNC is one on TRIGGER. Must not know: frames, what either line is for.
"""

from __future__ import annotations

from collections.abc import Callable

from etd_hal.ports import Changes, Edge, Gpio


class GpioWithJumper:
    """The board's GPIO, with that wire."""

    def __init__(self, gpio: Gpio, sync_line: int, give_edge: Callable[[], object]) -> None:
        """`give_edge` gives one on the trigger."""
        self._gpio = gpio
        self._up: Changes = ((sync_line, 1),)
        self._give_edge = give_edge

    def set(self, changes: Changes) -> None:
        """See `ports.Gpio`."""
        self._gpio.set(changes)
        if changes == self._up:
            self._give_edge()

    def get(self, line: int) -> int:
        """See `ports.Gpio`."""
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        """See `ports.Gpio`."""
        return self._gpio.edges()
