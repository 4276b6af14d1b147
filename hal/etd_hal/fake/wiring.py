"""What is wrong between a chain's register and the electrodes, for either kind of switch.

Owns: which of the faults are of that kind, and the way of swapped wires. Must not know: registers.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd_hal.fake.faults import AlsoSwitches, OutputsSwapped, SwitchOutput
from etd_hal.fake.faults_due import Faults

WiringFault = SwitchOutput | AlsoSwitches | OutputsSwapped


def wiring_faults(faults: Faults) -> tuple[WiringFault, ...]:
    """All that change what one state of the register connects."""
    if not faults.are_there:
        return ()
    return (*faults.of(SwitchOutput), *faults.of(AlsoSwitches), *faults.of(OutputsSwapped))


def outputs_behind(electrodes: Sequence[int], faults: Faults) -> tuple[int, ...]:
    """The chain output that each electrode is really wired to; `electrodes` is where it should."""
    at = list(electrodes)
    for swap in faults.of(OutputsSwapped):
        other = {swap.first: swap.second, swap.second: swap.first}
        at = [other.get(output, output) for output in at]
    return tuple(at)
