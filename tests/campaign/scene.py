"""A scene: what a program does on a board while a fault comes, and how its end is told.

Owns: what a case needs of a scene, and what an end can be. Must not know: which scenes there are,
faults.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from campaign.subject import Subject


class Over(Exception):
    """A scene that needs no more of its script: it has halted."""


@dataclass(frozen=True, slots=True)
class Said:
    """`seen`: `halted`, `refused`, `made safe`, or `nothing`. `after_ms`: from the fault on."""

    seen: str
    after_ms: float | None = None
    why: str = ""


class Scene(Protocol):
    """Its time is stepped, and its operations are counted from `play` on."""

    subject: Subject

    @property
    def pulse_pc(self) -> int:
        """Of what it asks for in one visit of an electrode: a phase, or both."""

    @property
    def leaves_supply_on(self) -> bool:
        """Whether it is on, or was found on, and nothing wanted it."""

    def prepare(self) -> None:
        """Up to where faults come."""

    def play(self) -> None:
        """While faults come. Raises: Over."""

    def play_on(self, is_long: bool) -> None:
        """After that, until each check has had its time (`is_long`), or a little. Raises: Over."""

    def insist(self) -> None:
        """After its halt: try what must not be possible any more."""

    def after_kill(self) -> None:
        """The process has ended in the middle of it."""

    def said(self, begun_ns: int) -> Said:
        """Of a fault that came at that time."""

    def problem(self) -> str | None:
        """Why a run without a fault does not count."""

    def close(self) -> None: ...
