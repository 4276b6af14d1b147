"""The stopper beside a fake board in stepped time: its checks fall into whatever is under way.

Owns: when it checks. Must not know: what a check does, who drives the board.

It is no process: the fake's time steps, and no other process would follow it.
"""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

from etd_hal.cutlatch import CutLatch
from etd_hal.errors import BusError
from etd_hal.fake.clock import SteppedClock
from etd_hal.ports import Changes, Gpio
from etd_hal.stopper import PERIOD_NS, Stopper
from etd_hal.supply_note import SupplyNote


class SteppedBeside:
    """See `backend.Beside`. It sets the outputs by `gpio`."""

    def __init__(self, gpio: Gpio, clock: SteppedClock) -> None:
        self._gpio = gpio
        self._clock = clock

    def stopper(
        self,
        latch: CutLatch,
        safe_changes: Changes,
        note: Path | None,
        priority: int | None,  # noqa: ARG002
        scan_core: int | None,  # noqa: ARG002
    ) -> SteppedStopper:
        """Nothing comes before it here, so it needs no priority."""
        kept = None if note is None else SupplyNote(note)
        stopper = Stopper(
            latch.words, self._clock.now_ns, lambda: self._gpio.set(safe_changes), kept
        )
        return SteppedStopper(stopper, self._clock)

    def sensors(
        self,
        module: str,  # noqa: ARG002
        arguments: tuple[object, ...],  # noqa: ARG002
        fds: tuple[int, ...],  # noqa: ARG002
        scan_core: int | None,  # noqa: ARG002
    ) -> NoReturn:
        """Raises: BusError: sensors are read by a process or a thread, in time that passes."""
        raise BusError("absent", "the sensors", "beginning", "the fake's time steps")


class SteppedStopper:
    """See `backend.StopperTask`."""

    refusals: tuple[str, ...] = ()

    def __init__(self, stopper: Stopper, clock: SteppedClock) -> None:
        self._stopper = stopper
        self._clock = clock
        self._is_needed = False
        self._has_turn = False
        self._has_ended = False

    def watch(self, is_needed: bool) -> None:
        """Woken it checks at once."""
        self._is_needed = is_needed and not self._has_ended
        if self._is_needed and not self._has_turn:
            self._has_turn = True
            self._turn()

    def end(self) -> None:
        """As the process does when the driving one is over, however that ended."""
        if not self._has_ended:
            self._has_ended, self._is_needed = True, False
            self._stopper.cut()
            self._stopper.note_supply()

    def _turn(self) -> None:
        if not self._is_needed:
            self._has_turn = False
            return
        self._stopper.check()
        self._clock.at(self._clock.now_ns() + PERIOD_NS, self._turn)
