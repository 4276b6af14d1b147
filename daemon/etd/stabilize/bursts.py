"""Bursts: one electrode gets a few pulses in quick succession, several times a second.

Owns: how many pulses, how fast, and which electrodes take turns in one burst. Must not know:
limits, hardware, clocks, what a pulse is.

Why: at the most current without discomfort, 6 pulses in a burst at 350 Hz, 15 bursts a second,
were felt strongest, about twice as strong as single ones (Kajimoto, Electro-tactile Display,
section 4.2; Kaczmarek, Webster and Radwin 1992, who tried 1 to 20 pulses at 200 to 1500 Hz,
balanced biphasic with 150 us a phase).

A burst is several visits, each with its own message, rest, limits and ledger entry. Between the
pulses of one electrode others have theirs: as many as fit into the interval share a burst, the
next group comes after it. Who shares one is spread over the chain (every third of the electrodes,
say), so that no jump of the selection takes longer than the rest, and neighbors are apart in time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

T = TypeVar("T")


class Bursts(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`pulses` in each burst, `rate_hz` inside it. How often a burst comes is the frame's rate."""

    pulses: Annotated[int, Meta(ge=2, le=20)]
    rate_hz: Annotated[float, Meta(ge=50.0, le=1_500.0)]

    @property
    def interval_us(self) -> float:
        """From the start of a pulse to that of the next one of the same burst."""
        return 1e6 / self.rate_hz


def groups(
    items: Sequence[T], interval_us: float, round_us: Callable[[Sequence[T]], float]
) -> tuple[tuple[T, ...], ...] | None:
    """The fewest groups such that a round of each fits into the interval; None if none does.

    `round_us` is the time that one pulse of each of a group takes, the way back included.
    """
    for count in range(1, len(items) + 1):
        found = tuple(tuple(items[first::count]) for first in range(count))
        if all(round_us(one) <= interval_us for one in found):
            return found
    return None
