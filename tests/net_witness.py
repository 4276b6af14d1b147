"""The net charge that a modelled body has left of what it got, electrode by electrode.

Owns: the sum, with a leak of a second, by the body's own account. Must not know: how the engine
counts it, bounds.
"""

from __future__ import annotations

import math

from etd_body.minimal import MinimalBody

_LEAK_NS = 1e9


class NetWitness:
    """`look` is called as time passes, at least once in some milliseconds."""

    def __init__(self, body: MinimalBody) -> None:
        self._body = body
        self._electrodes = range(body.electrode_count)
        self._before_pc = [0.0] * body.electrode_count
        self._at_ns = 0
        self._left_pc = [0.0] * body.electrode_count
        self.most_uc = 0.0

    def look(self, now_ns: int) -> None:
        decay = math.exp(-(now_ns - self._at_ns) / _LEAK_NS)
        got_pc = [self._body.charge_pc(electrode) for electrode in self._electrodes]
        each = zip(self._left_pc, got_pc, self._before_pc, strict=True)
        self._left_pc = [pc * decay + got - before for pc, got, before in each]
        self._before_pc, self._at_ns = got_pc, now_ns
        self.most_uc = max(self.most_uc, *(abs(pc) / 1e6 for pc in self._left_pc))
