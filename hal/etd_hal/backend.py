"""The ports of a board as a program gets them, and how to close them.

Owns: these types. It opens nothing and imports neither `linux` nor `fake`; `compose` makes them.
Must not know: how ports are opened, frames, people.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from etd_hal.bench import UNKNOWN_CORE, Host, KillTestProcess, Operator, ScanCore
from etd_hal.chips.codec import Codec
from etd_hal.cutlatch import CutLatch
from etd_hal.ports import Changes, Clock, Gpio, I2c, Marker, Spi, WakingClock
from etd_hal.wakeups import WakeUps

if TYPE_CHECKING:
    from etd_body.sensation import Felt


_NO_REALTIME = "real-time scheduling cannot be had from this backend"


class SideTask(Protocol):
    """What works beside the scan, and ends with it."""

    @property
    def refusals(self) -> tuple[str, ...]:
        """What was not granted, a sentence each. Waits until it has come up. Raises: BusError
        (`gone`: it did not).
        """
        ...

    def end(self) -> None:
        """Idempotent."""
        ...


class StopperTask(SideTask, Protocol):
    def watch(self, is_needed: bool) -> None:
        """The supply was switched on, or off."""
        ...


class Beside(Protocol):
    """Starts processes beside the scan's, and does not wait until they have come up."""

    def stopper(
        self,
        latch: CutLatch,
        safe_changes: Changes,
        note: Path | None,
        priority: int | None,
        scan_core: int | None,
    ) -> StopperTask:
        """The stopper: its only access to the board is setting the outputs to `safe_changes`. It
        keeps the `supply_note` there.
        """
        ...

    def sensors(
        self,
        module: str,
        arguments: tuple[object, ...],
        fds: tuple[int, ...],
        scan_core: int | None,
    ) -> SideTask:
        """An ordinary process, which inherits `fds`. It calls `main(i2c, clock, scan_core, is_over,
        *arguments)` of `module`; the arguments are read back from their `repr`. `scan_core()` is
        about the thread that starts the process. `is_over(seconds)` waits for so long, and is True
        when `main` is to return.
        """
        ...


@dataclass(frozen=True, slots=True)
class Backend:
    """The ports of a board, and how to close them.

    What happens on the board is timed with `clock`. What counts from a message of another process
    (a frame's ttl, the lease, the gateway's silence) is timed with `host_clock`, the machine's
    CLOCK_MONOTONIC, which all processes read. With a real board they are one clock; a fake's own
    may lag behind its machine's.

    Raises: ValueError, for a real board with two clocks or with longer timeouts.
    """

    name: Literal["linux", "fake"]
    spi: Spi
    gpio: Gpio
    i2c: I2c | None
    clock: WakingClock
    marker: Marker
    close: Callable[[], None]
    host_clock: Clock = field(kw_only=True)
    #: Of the DAC and the ADC behind `spi`.
    codec: Codec = field(kw_only=True)
    #: Of `clock`, which notes them itself; where it does not, the most is spun.
    wakeups: WakeUps = field(default_factory=WakeUps, kw_only=True)
    #: On a fake board a frame's ttl, the lease and the gateway's silence last so many times as
    #: long.
    timeout_factor: int = 1
    #: Facts of the machine, a sentence each.
    facts: tuple[str, ...] = ()
    #: What slows the machine down now, a sentence each. It asks the firmware: not within a scan.
    troubles: Callable[[], tuple[str, ...]] = tuple
    #: A digest that identifies the machine among its model; "" where there is none.
    identity: str = ""
    #: What a modelled body has felt since the last call; None where there is no such body, and on
    #: real hardware always.
    modelled: Callable[[], Felt] | None = None
    #: Makes the calling thread real-time, at a priority and on a core, and its process fit for it;
    #: a sentence for each thing that was not granted.
    set_up_realtime: Callable[[int, int | None], tuple[str, ...]] = lambda *_: (_NO_REALTIME,)
    #: About the calling thread. It reads files: not within a scan.
    scan_core: Callable[[], ScanCore] = lambda: UNKNOWN_CORE
    #: None: the ports are in this process alone, and so are the threads that work beside the scan.
    beside: Beside | None = None
    #: The scheduling of the calling thread alone; a sentence if it was not granted.
    set_up_urgent_thread: Callable[[int], str | None] = lambda _: _NO_REALTIME

    def __post_init__(self) -> None:
        if self.name == "linux" and (self.host_clock is not self.clock or self.timeout_factor != 1):
            raise ValueError("a real board has one clock, and its timeouts are not lengthened")


@dataclass(frozen=True, slots=True)
class Bench:
    """A board as the self-test needs it: the ports, with a stopper `beside` them, the machine, and
    the fake's operator.
    """

    backend: Backend
    host: Host
    #: None where a person operates the board.
    operator: Operator | None
    kill_test_process: KillTestProcess


class ReplaySamples(Protocol):
    """What the pulses of a record measured, told one by one."""

    def expect(self, electrode: int, samples_v: Sequence[float], *, has_prepulse: bool) -> None:
        """The next pulse at this electrode measures these: three for each phase."""
        ...


@dataclass(frozen=True, slots=True)
class ReplayStage:
    """A fake board in stepped time on which a record is played once more. `at` puts an action on
    the way of its clock: it runs when time comes to it.
    """

    backend: Backend
    samples: ReplaySamples
    at: Callable[[int, Callable[[], object]], None]
