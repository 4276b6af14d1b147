"""One touch of the load: what reads as the load, what reads as open, and what as neither.

Owns: the figures that a reading is compared with, and the round over all others while the touch is
held. Must not know: who is asked to touch what, checks.

The load's fixed end is on its first electrode. Whoever else it touches reads the load, alone on the
source and alone on ground; the fixed end reads it too, and everybody else reads open.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from etd.selftest.bed import Bed, DummyLoad
from etd.selftest.probe import TOLERANCE
from etd.selftest.prober import Prober

#: Both polarities, so often.
_READINGS = 2


@dataclass(frozen=True, slots=True)
class Look:
    """At the electrode that was asked for and, if it answers, at all others."""

    #: It reads the load in both polarities.
    answers: bool
    #: (source, ground): what it reads.
    read_v: tuple[float, float]
    #: Who else does not read as it should, if the touch was held while they were looked at.
    others: tuple[int, ...] = ()
    #: It still answered after the round over the others.
    is_held: bool = False

    @property
    def is_good(self) -> bool:
        return self.answers and self.is_held and not self.others


class Touch:
    """See the module. Made while the load is between its two electrodes, and alone."""

    def __init__(self, bed: Bed, prober: Prober, load: DummyLoad) -> None:
        """Raises: BusError, BoardFault, GuardRefusal, as all that probes."""
        self._prober = prober
        self._fixed = load.first
        self._electrodes = range(bed.loaded.array.count)
        self._step_v = bed.file.source.node_uv_per_code / 1e6
        readings = [self._both_v(load.second) for _ in range(_READINGS)]
        #: What the load makes of a probe.
        self.load_v = statistics.mean(volts for both in readings for volts in both)
        self._open_v = statistics.median(self._source_v(one) for one in bed.free)

    def look(self, asked: int) -> Look:
        """One probe from either side; a round over all others if it answers."""
        read_v = self._both_v(asked)
        if not all(self.is_load(volts) for volts in read_v):
            return Look(False, read_v)
        others = self.answering(asked)
        if not self.is_load(self._source_v(self._fixed)):
            others = (*others, self._fixed)
        if not self.is_load(self._source_v(asked)):
            return Look(True, read_v)
        return Look(True, read_v, others, is_held=True)

    def answering(self, but: int) -> tuple[int, ...]:
        """All that are not open, but this one and the fixed end."""
        return tuple(
            one
            for one in self._electrodes
            if one not in (but, self._fixed) and not self.is_open(self._source_v(one))
        )

    def reads_load(self, electrode: int) -> bool:
        return all(self.is_load(volts) for volts in self._both_v(electrode))

    def _both_v(self, electrode: int) -> tuple[float, float]:
        return self._source_v(electrode), self.read_v(electrode, is_anodic=False)

    def _source_v(self, electrode: int) -> float:
        return self.read_v(electrode, is_anodic=True)

    def read_v(self, electrode: int, is_anodic: bool) -> float:
        """One probe."""
        return self._prober.probe(electrode, is_anodic)[1].voltage_v

    def is_load(self, volts: float) -> bool:
        return abs(volts - self.load_v) <= TOLERANCE * self.load_v + self._step_v

    def is_open(self, volts: float) -> bool:
        return abs(volts - self._open_v) <= TOLERANCE * self._open_v + self._step_v
