"""What a ledger is made of: entries, lines that can be corrected, and windows of a second.

Owns: a pulse as the ledger is asked for it, what is booked of it, and the sums of what was booked
in the last second. Must not know: bounds, which electrode a window is of, clocks: time comes in.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

WINDOW_NS = 1_000_000_000


class Entry:
    """One pulse, or a part of it: its charge, its time, and the electrodes that carry it back.

    `returns` None: all others, each with `share` times its weight and never more than the whole
    charge; otherwise each named electrode is booked with all of the charge. `net_pc`: what all its
    phases leave, positive into the skin; None: all of its charge.
    """

    __slots__ = (
        "_pooled_pc",
        "charge_pc",
        "electrode",
        "net_pc",
        "on_us",
        "pulses",
        "returns",
        "share",
    )

    def __init__(
        self,
        electrode: int,
        charge_pc: int,
        on_us: int,
        returns: tuple[int, ...] | None,
        share: float,
        pulses: int = 1,
        net_pc: int | None = None,
    ) -> None:
        self.electrode: Final = electrode
        self.net_pc: Final = charge_pc if net_pc is None else net_pc
        self.charge_pc: Final = charge_pc
        self.on_us: Final = on_us
        self.returns: Final = returns
        self.share: Final = share
        #: 0 where the entry continues a pulse that is booked already, as after a probe.
        self.pulses: Final = pulses
        self._pooled_pc: Final = share_pc(share, charge_pc) if returns is None else 0

    def pooled_of(self, charge_pc: int) -> int:
        """What goes to the pool of its own or another charge; nothing with named returns."""
        if charge_pc == self.charge_pc:
            return self._pooled_pc
        return share_pc(self.share, charge_pc) if self.returns is None else 0


class Line:
    """One pulse in a window. The electrode's own window and the array's share the line."""

    __slots__ = ("begun_ns", "charge_pc", "on_us", "pooled_pc", "pulses", "through_pc")

    def __init__(
        self,
        begun_ns: int,
        charge_pc: int,
        through_pc: int = 0,
        pooled_pc: int = 0,
        on_us: int = 0,
        pulses: int = 0,
    ) -> None:
        self.begun_ns = begun_ns
        self.charge_pc = charge_pc
        #: The charge that returns through all others, and the share of it.
        self.through_pc = through_pc
        self.pooled_pc = pooled_pc
        self.on_us = on_us
        self.pulses = pulses


class Booking(Line):
    """What is booked of an entry now: a line of the windows that can be corrected."""

    __slots__ = ("before_ns", "booked_ns", "carried", "entry", "net_pc", "room_before_pc")

    def __init__(
        self,
        begun_ns: int,
        charge_pc: int,
        through_pc: int,
        pooled_pc: int,
        on_us: int,
        pulses: int,
        entry: Entry,
        carried: Line | None,
        before_ns: int | None,
        room_before_pc: int,
    ) -> None:
        self.begun_ns = begun_ns
        self.charge_pc = charge_pc
        self.through_pc = through_pc
        self.pooled_pc = pooled_pc
        self.on_us = on_us
        self.pulses = pulses
        self.entry: Final = entry
        #: When it was booked, and what it leaves as net charge.
        self.booked_ns: Final = begun_ns
        self.net_pc = worst_net_pc(entry, charge_pc)
        #: The line in the windows of named returns.
        self.carried = carried
        #: The state before it: when the electrode's last pulse began, and the least room of all.
        self.before_ns = before_ns
        self.room_before_pc = room_before_pc


class Window:
    """Sums of what was booked in the last second."""

    __slots__ = ("charge_pc", "lines", "on_us", "pooled_pc", "pulses", "through_pc")

    def __init__(self) -> None:
        self.lines: deque[Line] = deque()
        self.charge_pc = 0
        self.through_pc = 0
        self.pooled_pc = 0
        self.on_us = 0
        self.pulses = 0

    def book(self, line: Line) -> None:
        self.lines.append(line)
        self.charge_pc += line.charge_pc
        self.through_pc += line.through_pc
        self.pooled_pc += line.pooled_pc
        self.on_us += line.on_us
        self.pulses += line.pulses

    def take_back(self) -> None:
        """Removes the line that was booked last."""
        line = self.lines.pop()
        self.charge_pc -= line.charge_pc
        self.through_pc -= line.through_pc
        self.pooled_pc -= line.pooled_pc
        self.on_us -= line.on_us
        self.pulses -= line.pulses

    def drop_old(self, now_ns: int) -> None:
        """Removes what began a second ago or earlier."""
        lines, oldest_ns = self.lines, now_ns - WINDOW_NS
        while lines and lines[0].begun_ns <= oldest_ns:
            line = lines.popleft()
            self.charge_pc -= line.charge_pc
            self.through_pc -= line.through_pc
            self.pooled_pc -= line.pooled_pc
            self.on_us -= line.on_us
            self.pulses -= line.pulses


def carried_line(entry: Entry, now_ns: int, charge_pc: int) -> Line:
    """The line in the window of each named return."""
    is_alone = entry.returns is not None and len(entry.returns) == 1
    return Line(now_ns, charge_pc, pulses=entry.pulses if is_alone else 0)


def worst_net_pc(entry: Entry, worst_pc: int) -> int:
    """What a single phase leaves that has so much charge; of phases that balance, nothing."""
    if entry.net_pc > 0:
        return worst_pc
    return -worst_pc if entry.net_pc < 0 else 0


def share_pc(share: float, charge_pc: int) -> int:
    """Rounded up: the ledger errs on the side of more charge."""
    return math.ceil(charge_pc * share)
