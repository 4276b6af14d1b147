"""The place between what a frame wants and what the limits let through.

Owns: what a stabilizer gets and gives, and the order in which they ask. Must not know: limits,
hardware, clocks. Whatever comes out of here is a wish: `engine/limits.py` has the last word.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

#: No pulse is shorter, whoever asks.
SHORTEST_US = 20


@dataclass(frozen=True, slots=True)
class Wish:
    """One pulse as somebody would like it, and the weaker one that leads into it, if any.

    Whoever changes a part keeps the others: `dataclasses.replace`.
    """

    current_ua: int
    width_us: int
    #: Directly before the pulse, in the same message, the same way; both 0: none.
    prepulse_ua: int = 0
    prepulse_us: int = 0

    @property
    def is_possible(self) -> bool:
        """A pulse at all; anything else is a mistake of the stabilizer's."""
        return (
            self.current_ua >= 0
            and self.width_us >= SHORTEST_US
            and 0 <= self.prepulse_ua <= self.current_ua
            and self.prepulse_us >= 0
        )


@dataclass(frozen=True, slots=True)
class Known:
    """What the pulses so far have told of one electrode; None where unknown."""

    electrode: int
    is_touched: bool | None
    resistance_ohm: int | None
    voltage_v: float | None


class Stabilizer(Protocol):
    def ask(self, wish: Wish, known: Known) -> Wish:
        """The pulse this stabilizer would like, given the one before it would."""
        ...


def ask_all(stabilizers: Sequence[Stabilizer], wish: Wish, known: Known) -> Wish:
    """Each in turn, in the order of the body-site file."""
    for stabilizer in stabilizers:
        wish = stabilizer.ask(wish, known)
    return wish
