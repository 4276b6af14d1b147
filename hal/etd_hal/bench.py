"""What a self-test needs beside the ports: the machine under the board, and somebody's hand.

Owns: the contracts of both, kept by the kernel's side and by the fake.
Must not know: what is tested, which backend there is.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

StopName = Literal["emergency_stop", "wearer_stop"]


@dataclass(frozen=True, slots=True)
class Health:
    """How the machine is now; None for what its kernel does not tell."""

    temperature_c: float | None
    is_throttled: bool | None
    is_under_voltage: bool | None
    #: At any time since it was started, or since somebody had the firmware forget it.
    was_throttled: bool | None = None
    was_under_voltage: bool | None = None


@dataclass(frozen=True, slots=True)
class Obtained:
    """What the calling thread and its process really have of real time, asked of the kernel."""

    policy: str
    priority: int
    cores: tuple[int, ...]
    locked_kb: int
    #: All that the process has mapped: what there would be to lock.
    mapped_kb: int
    timer_slack_ns: int


@dataclass(frozen=True, slots=True)
class Timekeeping:
    """What the machine's clocks are worth."""

    #: What the kernel counts by.
    source: str
    #: Of CLOCK_MONOTONIC, by which everything is timed.
    resolution_ns: int
    #: Of many readings of it in a row, each less the one before: the smallest.
    least_step_ns: int
    #: The date that goes into reports.
    now: datetime.datetime
    #: The program was installed then: it cannot be earlier.
    not_before: datetime.datetime
    #: Whether the kernel's clock follows another's (NTP); None where it does not tell.
    is_synchronized: bool | None


class Host(Protocol):
    """The machine that the board hangs on."""

    def packages(self) -> Mapping[str, str | None]:
        """The version of each Python package that the backend needs; None where it is missing."""
        ...

    def problem(self) -> str | None:
        """Why the machine file cannot stand for this machine, with what to do."""
        ...

    def facts(self) -> tuple[str, ...]:
        """What is worth keeping with a report, a sentence each."""
        ...

    def health(self) -> Health: ...

    def free_memory_kb(self) -> int | None:
        """What can be had without swapping; None for what its kernel does not tell."""
        ...

    def timekeeping(self) -> Timekeeping: ...

    def keeps_pins(self) -> bool:
        """Whether outputs stay driven when the process that holds them is gone."""
        ...

    def set_up_realtime(self, priority: int, core: int | None) -> tuple[str, ...]:
        """For the calling thread; a sentence for each thing that was not granted."""
        ...

    def obtained(self) -> Obtained:
        """After `set_up_realtime`, by the same thread."""
        ...


class KillTestProcess(Protocol):
    """A process in the program's place, there to be killed."""

    def take_over(self) -> None:
        """Give the lines up; on return it holds the outputs, with the supply on (where there is an
        enable line) and the heartbeat going on. Raises: BusError.
        """
        ...

    def kill(self) -> float:
        """SIGKILL; after how many ms it held nothing any more."""
        ...

    def levels(self) -> Mapping[int, int]:
        """What each output line reads while nobody drives it. Raises: BusError."""
        ...

    def step_back(self) -> None:
        """End it, if it is still there; the lines are the program's again, at harmless levels.

        Raises: BusError.
        """
        ...


class Operator(Protocol):
    """Who stands at the board and does what is asked; each call returns at once."""

    def press(self, stop: StopName) -> None:
        """Press a stop and release it."""
        ...

    def hold(self, stop: StopName) -> None:
        """Press a stop, and keep it pressed until it may be let go of."""
        ...

    def let_go(self, stop: StopName) -> None:
        """Release the stop that is held."""
        ...

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        """Connect the dummy load of this value between these two electrodes, and to nothing else;
        any other goes off.
        """
        ...

    def misplaced(self, asked: int, found: tuple[int, ...]) -> None:
        """Hear that the load was asked for at one electrode, and that others answer."""
        ...

    def stand_back(self) -> None:
        """Hands off: what comes next can be felt."""
        ...
