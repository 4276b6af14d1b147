"""What a shift register does at a rising edge of its clock, with the faults that edges can have.

Owns: the register's next value. Must not know: how long it is, which chip it is in, latches.
"""

from __future__ import annotations

from etd_hal.fake.faults import DataFlipped, ExtraClock, LostClock
from etd_hal.fake.faults_due import Faults


def shifted(register: int, data: int, faults: Faults) -> int:
    """Longer by the new bit; called for each edge that the driver makes, which counts it."""
    if not faults.are_there:
        return register << 1 | data
    level = data ^ faults.edge_is_wrong(DataFlipped)
    edges = 1 - faults.edge_is_wrong(LostClock) + faults.edge_is_wrong(ExtraClock)
    for _ in range(edges):
        register = register << 1 | level
    return register
