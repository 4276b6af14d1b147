"""One variant of a class of faults, and where it means anything.

Owns: the shape of a kind. Must not know: which kinds there are.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from campaign.operations import Interference, Port
from campaign.places import Chosen
from campaign.subject import Subject
from etd_hal.fake.faults import Fault

#: Done to a subject directly before the operation.
Doing = Callable[[Subject], Interference | None]
BUSES: tuple[Port, ...] = ("spi", "set")


@dataclass(frozen=True)
class Kind:
    """See the module."""

    fault_class: str
    variant: str
    ports: tuple[Port, ...]
    do: Doing
    stays: bool = False
    #: Of what stays: it is behind no wire that a message goes through, and so the same fault from
    #: one part of a scene to the next.
    is_aside: bool = False
    #: What of the fake's it is, where it is one of these.
    fault: Fault | None = None
    #: By so much the program's own time may shift by it, and its pulses with that.
    shifts_ms: int = 0
    #: Another one, so many operations later.
    then: Kind | None = None
    then_after: int = 0

    @property
    def name(self) -> str:
        return f"{self.fault_class}: {self.variant}"

    @property
    def needs_time(self) -> bool:
        """Whether it is there for as long as a check may take to come."""
        return self.stays or (self.then is not None and self.then.stays)

    def may_come_at(self, port: Port) -> bool:
        return self.stays or port in self.ports

    def applies(self, number: int, port: Port, chosen: Chosen) -> bool:
        if not self.stays:
            return number in chosen.once and port in self.ports
        if self.is_aside:
            return number in chosen.parts
        return number in chosen.staying and number == self._of(chosen.ends.get(number, (number,)))

    def _of(self, ends: Sequence[int]) -> int:
        """One of them by lot, the same each time."""
        return ends[zlib.crc32(f"{self.name} {ends[0]}".encode()) % len(ends)]


def put_in(fault: Fault) -> Doing:
    return lambda subject: subject.fake.world.put_in(fault)
