"""The net charge that pulses leave on electrodes, summed pulse by pulse.

Owns: the sum, with a leak of a second, an even part to each return. Must not know: how the engine
counts it, bounds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from trace_decoder import Phase

_LEAK_NS = 1e9


def most_left_pc(
    visits: Iterable[tuple[Sequence[Phase], Sequence[int] | None]], electrodes: int
) -> float:
    """The most on any electrode after any visit: its phases, and its returns (None: all others)."""
    left_pc, at_ns, most_pc = [0.0] * electrodes, 0, 0.0
    for phases, named in visits:
        electrode, begun_ns = phases[0].electrode, phases[0].from_ns
        assert electrode is not None
        decay = math.exp((at_ns - begun_ns) / _LEAK_NS)
        net_pc = sum(phase.charge_pc if phase.is_anodic else -phase.charge_pc for phase in phases)
        returns = [it for it in range(electrodes) if it != electrode] if named is None else named
        left_pc = [pc * decay for pc in left_pc]
        left_pc[electrode] += net_pc
        for other in returns:
            left_pc[other] -= net_pc / len(returns)
        at_ns, most_pc = begun_ns, max(most_pc, *map(abs, left_pc))
    return most_pc
