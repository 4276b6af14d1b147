"""A minimal body: current source with leak and compliance, R-RC electrodes on one common tissue.

Owns: the exact course of voltage and charge for one electrode against the rest.
Must not know: chips, boards, clocks, what is felt.

What is exact: the electrode that stands alone on its side has its own capacitor, and its course is
a closed form in each regime of the source (delivering what it is told, held at the compliance,
delivering nothing), the instants between regimes included. What is lumped: the other side is a
resistance that shares the current by conductance. A charged electrode that is in a group drains
through its own resistances and the rest of those connected, each as if it were the only one.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, inf

from etd_body.electrode import Contact
from etd_body.interface import Side, Sides
from etd_body.network import Network, NetworkReader
from etd_body.source import Loop, parallel

#: Below this an electrode's capacitor counts as empty.
_EMPTY_V = 1e-4
#: Readings of `sides` that are kept: enough for every electrode of a stack in both polarities.
_CACHED_NETWORKS = 2_048
_PC = 1e12


class MinimalBody:
    """One contact per electrode over one tissue, behind one source. See `interface.Body`."""

    def __init__(
        self, contacts: Sequence[Contact], *, leak_ohm: float, compliance_v: float
    ) -> None:
        self._contacts = list(contacts)
        self._grounded = _grounded(contacts)
        self._leak_ohm = leak_ohm
        #: The leak, and beside it the resistors to ground at what is on the source.
        self._node_ohm = leak_ohm
        self._compliance_v = compliance_v
        self._source_a = 0.0
        self._t_ns = 0
        self._held_v: dict[int, float] = {}
        self._net_pc = [0.0] * len(contacts)
        self._absolute_pc = [0.0] * len(contacts)
        self._reader = NetworkReader(self._contacts)
        self._networks: dict[int, Network] = {}
        self._network = self._read((Side.OPEN,) * len(contacts))

    @property
    def electrode_count(self) -> int:
        return len(self._contacts)

    def contact(self, electrode: int) -> Contact:
        return self._contacts[electrode]

    def touch(self, t_ns: int, electrode: int, contact: Contact) -> None:
        """From `t_ns` on this electrode has another contact; its charge so far stays booked."""
        self._advance(t_ns)
        self._settle_books()
        self._contacts[electrode] = contact
        self._grounded = _grounded(self._contacts)
        self._held_v.pop(electrode, None)
        self._network = self._read(self._network.sides)

    def supply(self, t_ns: int, compliance_v: float) -> None:
        self._advance(t_ns)
        self._compliance_v = compliance_v

    def drive(self, t_ns: int, source_ua: float, sides: Sides) -> None:
        if len(sides) != len(self._contacts):
            raise ValueError(f"{len(sides)} sides for {len(self._contacts)} electrodes")
        self._advance(t_ns)
        self._source_a = source_ua * 1e-6
        if sides is not self._network.sides:
            self._network = self._read(sides)

    def node_voltage_v(self, t_ns: int) -> float:
        self._advance(t_ns)
        network = self._network
        open_v = min(self._source_a * self._node_ohm, self._compliance_v)
        if network.loop_ohm == inf:
            return open_v
        if network.lone is None:
            return min(open_v, self._source_a * parallel(self._node_ohm, network.loop_ohm))
        held_v = self._held_v.get(network.lone, 0.0) * network.direction
        return self._loop(network.lone).node_v(held_v)

    def charge_pc(self, electrode: int) -> float:
        shared = sum(
            group.net_pc_per_s for group in self._reader.sharing() if electrode in group.members
        )
        return self._net_pc[electrode] + shared * self._contacts[electrode].conductance_s

    def absolute_charge_pc(self, electrode: int) -> float:
        shared = sum(
            group.absolute_pc_per_s
            for group in self._reader.sharing()
            if electrode in group.members
        )
        return self._absolute_pc[electrode] + shared * self._contacts[electrode].conductance_s

    def absolute_charges_pc(self) -> list[float]:
        """That of every electrode, at once."""
        shared = [0.0] * len(self._contacts)
        for group in self._reader.sharing():
            for electrode in group.members:
                shared[electrode] += group.absolute_pc_per_s
        return [
            own_pc + pc_per_s * contact.conductance_s
            for own_pc, pc_per_s, contact in zip(
                self._absolute_pc, shared, self._contacts, strict=True
            )
        ]

    # What is connected

    def _read(self, sides: Sides) -> Network:
        found = self._networks.get(id(sides))
        if found is None:
            if len(self._networks) >= _CACHED_NETWORKS:
                self._networks.clear()
            found = self._networks[id(sides)] = self._reader.read(sides)
        self._node_ohm = self._leak_ohm
        for electrode in self._grounded:
            if sides[electrode] is Side.SOURCE:
                wire_ohm = self._contacts[electrode].resistance_ohm
                self._node_ohm = parallel(self._node_ohm, wire_ohm)
        return found

    def _settle_books(self) -> None:
        """Move what groups share to the electrodes' own accounts, before conductances change."""
        count = range(len(self._contacts))
        self._net_pc = [self.charge_pc(electrode) for electrode in count]
        self._absolute_pc = [self.absolute_charge_pc(electrode) for electrode in count]
        self._networks.clear()
        self._reader = NetworkReader(self._contacts)

    # Time

    def _advance(self, t_ns: int) -> None:
        if t_ns < self._t_ns:
            raise ValueError(f"time went back from {self._t_ns} ns to {t_ns} ns")
        duration_s = (t_ns - self._t_ns) * 1e-9
        self._t_ns = t_ns
        if duration_s == 0.0:
            return
        network = self._network
        for electrode in tuple(self._held_v):
            if electrode != network.lone:
                self._drain(electrode, duration_s)
        if network.lone is not None:
            self._flow(network.lone, duration_s)
        elif network.loop_ohm != inf and self._source_a > 0.0:
            self._flow_between_groups(duration_s)

    def _drain(self, electrode: int, duration_s: float) -> None:
        """Let a charged electrode run down through itself and those connected with it."""
        contact = self._contacts[electrode]
        group = self._network.connected
        rest_s = group.conductance_s - contact.conductance_s
        way_out = electrode in group.members and rest_s > 1e-12
        loop_ohm = contact.series_ohm + 1.0 / rest_s if way_out else inf
        tau_s = contact.capacitance_nf * 1e-9 * parallel(contact.parallel_ohm, loop_ohm)
        before_v = self._held_v[electrode]
        after_v = before_v * exp(-duration_s / tau_s)
        if abs(after_v) < _EMPTY_V:
            after_v = 0.0
            del self._held_v[electrode]
        else:
            self._held_v[electrode] = after_v
        if way_out:
            out_pc = tau_s * (before_v - after_v) / loop_ohm * _PC
            self._book(electrode, -out_pc)

    def _flow(self, electrode: int, duration_s: float) -> None:
        """Let the lone electrode's loop run, and book what has passed."""
        direction = self._network.direction
        held_v = self._held_v.pop(electrode, 0.0) * direction
        held_v, charge_c = self._loop(electrode).advance(held_v, duration_s)
        if abs(held_v) >= _EMPTY_V:
            self._held_v[electrode] = held_v * direction
        self._book(electrode, charge_c * _PC * direction)

    def _flow_between_groups(self, duration_s: float) -> None:
        network = self._network
        node_v = min(
            self._source_a * parallel(self._node_ohm, network.loop_ohm), self._compliance_v
        )
        charge_pc = node_v / network.loop_ohm * duration_s * _PC
        network.sources.share(charge_pc, network.sources.conductance_s)
        network.grounds.share(-charge_pc, network.grounds.conductance_s)

    def _book(self, electrode: int, charge_pc: float) -> None:
        """Charge into the skin at `electrode`, out of it at all others that are connected.

        The group's account gives the electrode a share too; its own account takes that back.
        """
        own_s = self._contacts[electrode].conductance_s
        group = self._network.connected
        others_s = group.conductance_s - own_s
        group.share(-charge_pc, others_s)
        self._net_pc[electrode] += charge_pc * (1.0 + own_s / others_s)
        self._absolute_pc[electrode] += abs(charge_pc) * (1.0 - own_s / others_s)

    def _loop(self, electrode: int) -> Loop:
        """The source with all that is in series with the lone electrode's capacitor."""
        contact = self._contacts[electrode]
        others_s = self._network.connected.conductance_s - contact.conductance_s
        return Loop(
            self._source_a,
            self._node_ohm,
            self._compliance_v,
            contact.series_ohm + 1.0 / others_s,
            contact.parallel_ohm,
            contact.capacitance_nf * 1e-9,
        )


def _grounded(contacts: Sequence[Contact]) -> tuple[int, ...]:
    """The electrodes with a resistor to the board's ground."""
    return tuple(i for i, contact in enumerate(contacts) if contact.kind == "grounded")
