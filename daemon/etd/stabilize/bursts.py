"""Bursts: an electrode gets several pulses in quick succession, several times a second.

Owns: the number of pulses, their rate, and which electrodes alternate in one burst. Must not know:
limits, hardware, clocks, what a pulse is.

Why: at the highest current without discomfort, bursts of 6 pulses at 350 Hz, 15 bursts a second,
were felt strongest, about twice as strong as single pulses (Kajimoto, Electro-tactile Display,
section 4.2; Kaczmarek, Webster and Radwin 1992, who tested 1 to 20 pulses at 200 to 1500 Hz,
balanced biphasic with 150 us a phase).

Each pulse of a burst has its own message, rest, limits and ledger entry. The pulses of several
electrodes alternate: as many as fit into the interval share a burst, the next group follows. A
group is spread over the chain (every third electrode, for example), so that shifting the selection
never takes longer than the rest, and neighbors are apart in time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

T = TypeVar("T")


class Bursts(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`pulses` in each burst, `rate_hz` within it. The frame's rate is that of the bursts."""

    pulses: Annotated[int, Meta(ge=2, le=20)]
    rate_hz: Annotated[float, Meta(ge=50.0, le=1_500.0)]

    @property
    def interval_us(self) -> float:
        """From the start of a pulse to the start of the next one in the burst."""
        return 1e6 / self.rate_hz


def groups(
    items: Sequence[T], interval_us: float, round_us: Callable[[Sequence[T]], float]
) -> tuple[tuple[T, ...], ...] | None:
    """The fewest groups of which one pulse of each member fits into the interval; None if none.

    `round_us` is the time for one pulse of each member, including the shift back to the first.
    """
    for count in range(1, len(items) + 1):
        found = tuple(tuple(items[first::count]) for first in range(count))
        if all(round_us(one) <= interval_us for one in found):
            return found
    return None
