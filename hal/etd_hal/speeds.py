"""The timings of one machine: one for each speed that its clocks have been seen at.

Owns: which timings are known, which of them holds now, and what was made of messages by each. Must
not know: how a timing is fitted (`timing.py`), pulses, when to look.

SPI is divided from a clock that follows the load of the machine unless it is fixed. A speed that
comes back is recognized by a few messages, instead of being calibrated again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from etd_hal.boardfile import MachineFile
from etd_hal.chips.codec import Codec
from etd_hal.ports import Message
from etd_hal.timing import Round, Timing, calibrate, like_a_pulse_us, nearest, recognize

#: A clock that follows its load has two or three speeds.
_MOST_KNOWN = 3
K = TypeVar("K")
V = TypeVar("V")


class Speeds(Generic[K, V]):
    """`duration_ns` sends a message at DAC code 0, and returns how long the call took."""

    def __init__(
        self, machine: MachineFile, codec: Codec, duration_ns: Callable[[Message], int]
    ) -> None:
        self._machine = machine
        self._codec = codec
        self._duration_ns = duration_ns
        #: The one that was used last comes last.
        self._known: dict[Timing, dict[K, V]] = {}
        #: Of a speed that was left during a calibration: the rounds that it has had so far.
        self._too_few: list[list[Round]] = []

    def calibrate(self, meanwhile: Callable[[], None]) -> tuple[Timing, dict[K, V]]:
        """The timing that holds now, and a place for what is made by it. Raises: BoardFault,
        BusError.
        """
        measured = self._measured(meanwhile)
        now, *others = calibrate(measured, self._machine, self._codec, self._too_few)
        for timing in (*others, now):
            alike = nearest(like_a_pulse_us(timing), self._known, self._machine)
            if alike is not None:
                del self._known[alike]
            elif len(self._known) >= _MOST_KNOWN:
                del self._known[next(iter(self._known))]
            self._known[timing] = {}
        return self._use(now)

    def recognize(self, meanwhile: Callable[[], None]) -> tuple[Timing, dict[K, V]] | None:
        """The same, of the known ones; None if none of them holds, or if there is one alone: then
        no change of speed explains why messages have drifted from it. Raises: BusError.
        """
        if len(self._known) < 2:
            return None
        measured = self._measured(meanwhile)
        timing = recognize(measured, self._known, self._machine, self._codec)
        return None if timing is None else self._use(timing)

    def _use(self, timing: Timing) -> tuple[Timing, dict[K, V]]:
        made = self._known[timing] = self._known.pop(timing, {})
        return timing, made

    def _measured(self, meanwhile: Callable[[], None]) -> Callable[[Message], int]:
        def duration_ns(message: Message) -> int:
            meanwhile()
            return self._duration_ns(message)

        return duration_ns
