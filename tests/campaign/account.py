"""The body's own account of what flowed: by electrode, alone on its side or as a return.

Owns: that account, kept from what the skin conducts. Must not know: drivers, ledgers, what was
meant to flow.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd_body.electrode import Contact
from etd_body.interface import Side, Sides
from etd_body.minimal import MinimalBody


@dataclass(frozen=True, slots=True)
class Account:
    """In pC, since power-up, all current counted positive."""

    #: By electrode: alone on its side of the source, and one of several.
    alone_pc: tuple[float, ...]
    shared_pc: tuple[float, ...]
    #: The largest that one electrode got in a stretch of current without a gap.
    longest_alone_pc: float
    longest_shared_pc: float


class AccountedBody:
    """A body that conducts, watched. It is a `Touchable`."""

    def __init__(self, body: MinimalBody) -> None:
        self._body = body
        count = body.electrode_count
        self._sides: Sides = (Side.OPEN,) * count
        self._seen_pc = [0.0] * count
        self._alone_pc = [0.0] * count
        self._shared_pc = [0.0] * count
        self._stretch_pc = [0.0] * count
        self._longest_alone_pc = self._longest_shared_pc = 0.0

    @property
    def electrode_count(self) -> int:
        return self._body.electrode_count

    def contact(self, electrode: int) -> Contact:
        return self._body.contact(electrode)

    def touch(self, t_ns: int, electrode: int, contact: Contact) -> None:
        self._body.touch(t_ns, electrode, contact)

    def supply(self, t_ns: int, compliance_v: float) -> None:
        self._body.supply(t_ns, compliance_v)

    def drive(self, t_ns: int, source_ua: float, sides: Sides) -> None:
        self._body.drive(t_ns, source_ua, sides)
        self._count()
        if source_ua <= 0.0 or sides != self._sides:
            self._stretch_pc = [0.0] * self.electrode_count
        self._sides = sides

    def node_voltage_v(self, t_ns: int) -> float:
        return self._body.node_voltage_v(t_ns)

    def charge_pc(self, electrode: int) -> float:
        return self._body.charge_pc(electrode)

    def absolute_charge_pc(self, electrode: int) -> float:
        return self._body.absolute_charge_pc(electrode)

    def account(self, now_ns: int) -> Account:
        """What flowed until now, also of a current that still flows."""
        self._body.node_voltage_v(now_ns)
        self._count()
        return self.counted()

    def counted(self) -> Account:
        """What flowed until the source or a side was changed last; moves no time."""
        return Account(
            tuple(self._alone_pc),
            tuple(self._shared_pc),
            self._longest_alone_pc,
            self._longest_shared_pc,
        )

    def _count(self) -> None:
        """What came since the last call, by the sides that were connected meanwhile."""
        on_source = self._sides.count(Side.SOURCE)
        on_ground = self._sides.count(Side.GROUND)
        charges_pc = self._body.absolute_charges_pc()
        for electrode, (side, now_pc) in enumerate(zip(self._sides, charges_pc, strict=True)):
            more_pc = now_pc - self._seen_pc[electrode]
            if more_pc <= 0.0:
                continue
            self._seen_pc[electrode] = now_pc
            self._stretch_pc[electrode] += more_pc
            stretch_pc = self._stretch_pc[electrode]
            if (on_source if side is Side.SOURCE else on_ground) == 1:
                self._alone_pc[electrode] += more_pc
                self._longest_alone_pc = max(self._longest_alone_pc, stretch_pc)
            else:
                self._shared_pc[electrode] += more_pc
                self._longest_shared_pc = max(self._longest_shared_pc, stretch_pc)
