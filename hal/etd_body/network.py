"""What a set of connections means for a given skin: who drives, who returns, through how much.

Owns: the reading of `sides` (one electrode against the rest, two groups, or no loop at all) and
the bookkeeping of charge that is shared by conductance.
Must not know: time, voltages, the source.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf

from etd_body.electrode import Contact
from etd_body.interface import Side, Sides


class Group:
    """Electrodes that share a charge by their conductance.

    Sharing is booked once for the group, in pC per siemens, and multiplied out when somebody asks:
    a pulse against 255 returns costs no more than one against 7.
    """

    __slots__ = ("absolute_pc_per_s", "conductance_s", "members", "net_pc_per_s")

    def __init__(self, members: frozenset[int], contacts: Sequence[Contact]) -> None:
        self.members = members
        self.conductance_s = sum(contacts[member].conductance_s for member in members)
        self.net_pc_per_s = 0.0
        self.absolute_pc_per_s = 0.0

    def share(self, charge_pc: float, conductance_s: float) -> None:
        """Give `charge_pc` to the members, over `conductance_s` (that of those who take part)."""
        self.net_pc_per_s += charge_pc / conductance_s
        self.absolute_pc_per_s += abs(charge_pc) / conductance_s


@dataclass(frozen=True, slots=True)
class Network:
    """`sides`, read for one skin.

    `lone` is the electrode alone on its side, when current can flow through it; `direction` is +1
    when that side is the source's. Without a lone electrode, `sources` and `grounds` are two
    groups, `loop_ohm` between them; inf means that no current can flow.
    """

    sides: Sides
    connected: Group
    lone: int | None
    direction: int
    loop_ohm: float
    sources: Group
    grounds: Group


class NetworkReader:
    """Reads `sides` against a set of contacts, and keeps the groups whose charge is booked."""

    def __init__(self, contacts: Sequence[Contact]) -> None:
        self._contacts = contacts
        self._groups: dict[frozenset[int], Group] = {}
        self._sharing: dict[frozenset[int], Group] = {}

    def sharing(self) -> tuple[Group, ...]:
        """The groups that charge can be booked on: few, however many networks were read."""
        return tuple(self._sharing.values())

    def read(self, sides: Sides) -> Network:
        touching = [i for i, contact in enumerate(self._contacts) if contact.conductance_s > 0.0]
        sources = self._group(i for i in touching if sides[i] is Side.SOURCE)
        grounds = self._group(i for i in touching if sides[i] is Side.GROUND)
        connected = self._group(sources.members | grounds.members)
        lone, direction = _lone(sources.members, grounds.members)
        for group in (connected,) if lone is not None else (connected, sources, grounds):
            self._sharing[group.members] = group
        return Network(
            sides, connected, lone, direction, _loop_ohm(sources, grounds), sources, grounds
        )

    def _group(self, members: Iterable[int]) -> Group:
        key = frozenset(members)
        found = self._groups.get(key)
        if found is None:
            found = self._groups[key] = Group(key, self._contacts)
        return found


def _lone(sources: frozenset[int], grounds: frozenset[int]) -> tuple[int | None, int]:
    if not sources or not grounds:
        return None, 0
    if len(sources) == 1:
        return next(iter(sources)), 1
    if len(grounds) == 1:
        return next(iter(grounds)), -1
    return None, 0


def _loop_ohm(sources: Group, grounds: Group) -> float:
    if not sources.members or not grounds.members:
        return inf
    return 1.0 / sources.conductance_s + 1.0 / grounds.conductance_s
