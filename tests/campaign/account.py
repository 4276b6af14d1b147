"""The body's own account of what flowed: by electrode, alone on its side or as a return.

Owns: that account, kept from what the skin conducts, and when current flowed. Must not know:
drivers, ledgers, what was meant to flow.
"""

from __future__ import annotations

from bisect import bisect_right
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


class Course:
    """What had flowed by when, of a run in which nothing was wrong."""

    def __init__(self) -> None:
        self._times_ns: list[int] = []
        self._accounts: list[Account] = []

    def add(self, t_ns: int, account: Account) -> None:
        self._times_ns.append(t_ns)
        self._accounts.append(account)

    @property
    def last(self) -> Account:
        """Raises: IndexError, where nothing has flowed."""
        return self._accounts[-1]

    def until(self, t_ns: int) -> Account | None:
        """None: nothing yet."""
        at = bisect_right(self._times_ns, t_ns)
        return self._accounts[at - 1] if at else None


class AccountedBody:
    """A body that conducts, watched. It is a `Touchable`. With a `course` each end of a current is
    put down there.
    """

    def __init__(self, body: MinimalBody, course: Course | None = None) -> None:
        self._body = body
        self._course = course
        self._driven_ns = 0
        self._marked_ns = 0
        #: When current flowed first since `mark`, and last; None: it has not.
        self.first_ns: int | None = None
        self.last_ns: int | None = None
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
        has_flowed = self._count(t_ns)
        if source_ua <= 0.0 or sides != self._sides:
            self._stretch_pc = [0.0] * self.electrode_count
            if has_flowed and self._course is not None:
                self._course.add(t_ns, self.counted())
        self._sides, self._driven_ns = sides, t_ns

    def mark(self, now_ns: int) -> None:
        """From now on it is noted when current flows."""
        self._marked_ns = now_ns
        self.first_ns = self.last_ns = None

    def node_voltage_v(self, t_ns: int) -> float:
        return self._body.node_voltage_v(t_ns)

    def charge_pc(self, electrode: int) -> float:
        return self._body.charge_pc(electrode)

    def absolute_charge_pc(self, electrode: int) -> float:
        return self._body.absolute_charge_pc(electrode)

    def absolute_charges_pc(self) -> list[float]:
        return self._body.absolute_charges_pc()

    def account(self, now_ns: int) -> Account:
        """What flowed until now, also of a current that still flows."""
        self._body.node_voltage_v(now_ns)
        self._count(now_ns)
        return self.counted()

    def counted(self) -> Account:
        """What flowed until the source or a side was changed last; moves no time."""
        return Account(
            tuple(self._alone_pc),
            tuple(self._shared_pc),
            self._longest_alone_pc,
            self._longest_shared_pc,
        )

    def _count(self, now_ns: int) -> bool:
        """What came since the last call, by the sides that were connected meanwhile; whether
        anything did.
        """
        has_flowed = False
        on_source = self._sides.count(Side.SOURCE)
        on_ground = self._sides.count(Side.GROUND)
        charges_pc = self._body.absolute_charges_pc()
        for electrode, (side, now_pc) in enumerate(zip(self._sides, charges_pc, strict=True)):
            more_pc = now_pc - self._seen_pc[electrode]
            if more_pc <= 0.0:
                continue
            has_flowed = True
            self._seen_pc[electrode] = now_pc
            self._stretch_pc[electrode] += more_pc
            stretch_pc = self._stretch_pc[electrode]
            if (on_source if side is Side.SOURCE else on_ground) == 1:
                self._alone_pc[electrode] += more_pc
                self._longest_alone_pc = max(self._longest_alone_pc, stretch_pc)
            else:
                self._shared_pc[electrode] += more_pc
                self._longest_shared_pc = max(self._longest_shared_pc, stretch_pc)
        if has_flowed:
            if self.first_ns is None:
                self.first_ns = max(self._driven_ns, self._marked_ns)
            self.last_ns = now_ns
        return has_flowed
