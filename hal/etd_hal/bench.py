"""What the self-test needs beside the ports: the machine under the board, and an operator.

Owns: the contracts of both, kept by the kernel's side and by the fake.
Must not know: what is tested, which backend there is.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

StopName = Literal["emergency_stop", "wearer_stop"]
#: Inputs of which one edge counts.
EdgeName = Literal["trigger", "too_strong"]


@dataclass(frozen=True, slots=True)
class Health:
    """The state of the machine now; None for what its kernel does not report."""

    temperature_c: float | None
    is_throttled: bool | None
    is_under_voltage: bool | None
    #: At any time since the start, or since the firmware's record was cleared.
    was_throttled: bool | None = None
    was_under_voltage: bool | None = None

    @property
    def troubles(self) -> tuple[str, ...]:
        """What slows the machine down now, a sentence each."""
        found = []
        if self.is_throttled:
            found.append("the firmware slows the machine down now: cool it, and check its supply")
        if self.is_under_voltage:
            found.append("the machine is short of voltage now: its own supply, and a short cable")
        return tuple(found)


@dataclass(frozen=True, slots=True)
class CpuClock:
    """The clock of the processor's cores; all in kHz."""

    governor: str
    least_khz: int
    most_khz: int
    now_khz: int

    @property
    def is_fixed(self) -> bool:
        return self.governor == "performance" or self.least_khz == self.most_khz

    def __str__(self) -> str:
        least, most, now = (khz // 1_000 for khz in (self.least_khz, self.most_khz, self.now_khz))
        return f"governor {self.governor}, {least} to {most} MHz, now {now} MHz"


@dataclass(frozen=True, slots=True)
class Obtained:
    """The real-time settings that the calling thread and its process have, read from the kernel."""

    policy: str
    priority: int
    cores: tuple[int, ...]
    locked_kb: int
    #: All that the process has mapped: what there would be to lock.
    mapped_kb: int
    timer_slack_ns: int


@dataclass(frozen=True, slots=True)
class ScanCore:
    """What the kernel does with a real-time thread that does not sleep, on the scan thread's core;
    None for what cannot be read.
    """

    #: None: the thread may run on several.
    core: int | None
    #: Nothing else is scheduled on it (`isolcpus=`).
    is_isolated: bool | None
    #: Takes real-time threads off a core for a part of each second.
    has_throttle: bool | None
    #: The same for ordinary threads that wait for the core, since Linux 6.12.
    has_fair_server: bool | None

    @property
    def is_left_alone(self) -> bool:
        """The kernel never takes the thread off, and nothing else needs the core. Whatever is not
        known is taken not to be so.
        """
        is_its_own = self.core is not None and self.is_isolated is True
        return is_its_own and self.has_throttle is False and self.has_fair_server is False

    def __str__(self) -> str:
        core = "no core of its own" if self.core is None else f"core {self.core}"
        isolated = {True: "isolated", False: "not isolated", None: "isolation not known"}
        state = {True: "on", False: "off", None: "not known"}
        return (
            f"{core}, {isolated[self.is_isolated]}; real-time throttle {state[self.has_throttle]},"
            f" fair server {state[self.has_fair_server]}"
        )


UNKNOWN_CORE = ScanCore(None, None, None, None)


@dataclass(frozen=True, slots=True)
class Timekeeping:
    """The quality of the machine's clocks."""

    #: The kernel's clock source.
    source: str
    #: The resolution of CLOCK_MONOTONIC, which times everything.
    resolution_ns: int
    #: The smallest difference between two readings in a row, of many.
    least_step_ns: int
    #: The date that goes into reports.
    now: datetime.datetime
    #: When the program was installed: the date cannot be earlier.
    not_before: datetime.datetime
    #: Whether the kernel's clock is synchronized (NTP); None where the kernel does not report it.
    is_synchronized: bool | None


class Host(Protocol):
    """The machine that drives the board."""

    def packages(self) -> Mapping[str, str | None]:
        """The version of each Python package that the backend needs; None where it is missing."""
        ...

    def problem(self) -> str | None:
        """Why the machine file does not fit this machine, with what to do."""
        ...

    def facts(self) -> tuple[str, ...]:
        """Facts to keep with a report, a sentence each."""
        ...

    def health(self) -> Health: ...

    def cpu_clock(self) -> CpuClock | None:
        """None where the kernel changes no clock, or does not report it."""
        ...

    def free_memory_kb(self) -> int | None:
        """Memory available without swapping; None where the kernel does not report it."""
        ...

    def timekeeping(self) -> Timekeeping: ...

    def keeps_pins(self) -> bool:
        """Whether outputs stay driven when the process that holds them is gone."""
        ...

    def set_up_realtime(self, priority: int, core: int | None) -> tuple[str, ...]:
        """Make the calling thread real-time. Returns a sentence for each thing that was not
        granted.
        """
        ...

    def obtained(self) -> Obtained:
        """Called after `set_up_realtime`, by the same thread."""
        ...

    def scan_core(self) -> ScanCore:
        """Called by the thread that it is about."""
        ...


class KillTestProcess(Protocol):
    """A process that takes the program's place, to be killed."""

    def take_over(self) -> None:
        """Hand the lines over; on return the process drives the outputs, with the supply on (where
        there is an enable line) and the heartbeat running. Raises: BusError.
        """
        ...

    def kill(self) -> float:
        """Send SIGKILL. Returns after how many ms the process held no line any more."""
        ...

    def levels(self) -> Mapping[int, int]:
        """The level of each output line while no process drives it. Raises: BusError."""
        ...

    def step_back(self) -> None:
        """End the process, if it still runs, and take the lines back at harmless levels.

        Raises: BusError.
        """
        ...


class Operator(Protocol):
    """The operator at the board, who does what is asked; each call returns at once."""

    def press(self, stop: StopName) -> None:
        """Press a stop and release it."""
        ...

    def hold(self, stop: StopName) -> None:
        """Press a stop, and keep it pressed until `let_go`."""
        ...

    def let_go(self, stop: StopName) -> None:
        """Release the stop that is held."""
        ...

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        """Connect the dummy load of this value between these two electrodes, and to nothing else;
        any other goes off.
        """
        ...

    def ground(self, load_ohm: int, electrode: int) -> None:
        """Connect the dummy load of this value between this electrode and the board's ground, and
        to nothing else; any other goes off.
        """
        ...

    def misplaced(self, asked: int, found: tuple[int, ...]) -> None:
        """Report that the load was requested at electrode `asked`, and that `found` measure it."""
        ...

    def stand_back(self) -> None:
        """Do not touch the board: what comes next can be felt."""
        ...
