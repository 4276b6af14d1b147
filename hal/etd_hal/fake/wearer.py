"""The wearer of a live fake board, who tests the stop before current flows, as every wearer must.

Owns: when the stop is pressed and released. Must not know: sessions, states.

The stop is tested when the stop lines are first read, and again when they are first read after the
supply was switched off: the next wearer may count as another person.
"""

from __future__ import annotations

from collections.abc import Callable

from etd_hal.boardfile import Guards
from etd_hal.ports import Changes, Edge, Gpio


class GpioWithWearer:
    """The board's GPIO, with a wearer beside it."""

    def __init__(self, gpio: Gpio, guards: Guards, try_stop: Callable[[], object]) -> None:
        """`try_stop` presses the stop, and releases it."""
        self._gpio = gpio
        self._try_stop = try_stop
        self._enable = guards.hv_enable
        self._is_supplied = False
        self._has_tried = False

    def set(self, changes: Changes) -> None:
        """See `ports.Gpio`."""
        self._gpio.set(changes)
        if self._enable == "absent":
            return
        for line, value in changes:
            if line == self._enable.line:
                self._is_supplied = value == self._enable.on
                self._has_tried &= not self._is_supplied

    def get(self, line: int) -> int:
        """See `ports.Gpio`."""
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        """See `ports.Gpio`."""
        if not self._has_tried and not self._is_supplied:
            self._has_tried = True
            self._try_stop()
        return self._gpio.edges()
