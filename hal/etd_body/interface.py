"""What a body is to the board it is connected to.

Owns: the vocabulary of connections (`Side`) and the Protocol that every body model keeps, so that
a finer model takes a coarser one's place without a change anywhere but in the skin.
Must not know: how a model computes, chips, buses, clocks.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Protocol


class Side(IntEnum):
    """Where the switch connects an electrode."""

    OPEN = 0
    SOURCE = 1
    GROUND = 2


#: One entry per electrode. Hand in the same tuple object for the same state: models cache by it.
Sides = tuple[Side, ...]


class Body(Protocol):
    """Skin and the network around it: current source, leak to ground, compliance, electrodes.

    Continuous in time: what is told at `t_ns` holds from then on, until something else is told.
    Times never go back. The source delivers what it is told unless its node would rise above the
    compliance; the leak takes its share first. Nothing connected therefore reads as the current
    times the leak, cut off at the compliance.
    """

    @property
    def electrode_count(self) -> int: ...

    def supply(self, t_ns: int, compliance_v: float) -> None:
        """From `t_ns` on the source can lift its node to `compliance_v`; 0 is a supply off."""
        ...

    def drive(self, t_ns: int, source_ua: float, sides: Sides) -> None:
        """From `t_ns` on the source is told `source_ua`, and `sides` is what is connected."""
        ...

    def node_voltage_v(self, t_ns: int) -> float:
        """The voltage of the source's node against ground at `t_ns`."""
        ...

    def charge_pc(self, electrode: int) -> float:
        """Net charge so far, in pC, positive into the skin there."""
        ...

    def absolute_charge_pc(self, electrode: int) -> float:
        """Charge so far in either direction, in pC: what the skin was given, not what is left."""
        ...
