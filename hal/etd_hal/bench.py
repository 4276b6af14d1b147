"""What a self-test needs beside the ports: the machine under the board, and somebody's hand.

Owns: the contracts of both, kept by the kernel's side and by the fake.
Must not know: what is tested, which backend there is.
"""

from __future__ import annotations

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

    def keeps_pins(self) -> bool:
        """Whether outputs stay driven when the process that holds them is gone."""
        ...

    def set_up_realtime(self, priority: int, core: int | None) -> tuple[str, ...]:
        """For the calling thread; a sentence for each thing that was not granted."""
        ...


class Hand(Protocol):
    """Who stands at the board and does what is asked; each call returns at once."""

    def press(self, stop: StopName) -> None:
        """Press a stop and release it."""
        ...

    def clip(self, first: int, second: int) -> None:
        """Connect the dummy load between these two electrodes, and to nothing else."""
        ...

    def stand_back(self) -> None:
        """Hands off: what comes next can be felt."""
        ...
