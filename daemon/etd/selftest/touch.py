"""One touch of the load: what reads as the load, what reads as open, and what as neither.

Owns: the figures that a reading is compared with, and the round over all others while the touch is
held. Must not know: who is asked to touch what, checks.

The load's fixed end is on its first electrode. Whoever else it touches reads the load, alone on the
source and alone on ground; the fixed end reads it too, and everybody else reads open. The others
are looked at in one polarity: a walk with another load has the other one.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from etd.selftest.fixture import DummyLoad, Fixture
from etd.selftest.prober import Prober
from etd.selftest.readings import NearerOf, is_near_v

#: Both polarities, so often: of the load before the walk, and of what answers while it is touched.
#: A second load may be ten codes of the ADC: what is a switch's resistance there is its noise here.
_READINGS_BEFORE, _READINGS = 8, 4


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

    def __init__(
        self, fixture: Fixture, prober: Prober, load: DummyLoad, *, others_anodic: bool = True
    ) -> None:
        """`others_anodic`: the others are looked at alone on the source, or else alone on ground.

        Raises: BusError, BoardFault, GuardRefusal, as all that probes.
        """
        self._prober = prober
        self.others_anodic = others_anodic
        self._fixed = load.first
        self._electrodes = range(fixture.loaded.array.count)
        self._source = fixture.file.source
        readings = [self._once_v(load.second) for _ in range(_READINGS_BEFORE)]
        #: What the load makes of a probe.
        self.load_v = statistics.mean(volts for both in readings for volts in both)
        self._open_v = statistics.median(self._in_round_v(electrode) for electrode in fixture.free)

    def look(self, asked: int) -> Look:
        """One probe from either side; some more, and a round over all others, if it answers."""
        read_v = self._once_v(asked)
        if any(self.nearer.is_open(volts) for volts in read_v):
            return Look(False, read_v)
        read_v = self._mean_v(read_v, asked)
        if not all(self.is_load(volts) for volts in read_v):
            return Look(False, read_v)
        others = self.answering(asked)
        if not self.is_load(self._steady_v(self._fixed)):
            others = (*others, self._fixed)
        if not self.is_load(self._steady_v(asked)):
            return Look(True, read_v)
        return Look(True, read_v, others, is_held=True)

    def answering(self, but: int) -> tuple[int, ...]:
        """All that are not open, but this one and the fixed end."""
        return tuple(
            electrode
            for electrode in self._electrodes
            if electrode not in (but, self._fixed) and not self.is_open(self._in_round_v(electrode))
        )

    def reads_load(self, electrode: int) -> bool:
        both_v = self._mean_v(self._once_v(electrode), electrode)
        return all(self.is_load(volts) for volts in both_v)

    @property
    def nearer(self) -> NearerOf:
        return NearerOf(self.load_v, self._open_v, self._source.node_uv_per_code / 1e6)

    def _once_v(self, electrode: int) -> tuple[float, float]:
        """(source, ground)."""
        return self.read_v(electrode, is_anodic=True), self.read_v(electrode, is_anodic=False)

    def _mean_v(self, first_v: tuple[float, float], electrode: int) -> tuple[float, float]:
        """Of all readings of one look, with these first ones."""
        more = [self._once_v(electrode) for _ in range(_READINGS - 1)]
        source_v, ground_v = zip(first_v, *more, strict=True)
        return statistics.mean(source_v), statistics.mean(ground_v)

    def _steady_v(self, electrode: int) -> float:
        return statistics.mean(self._in_round_v(electrode) for _ in range(_READINGS))

    def _in_round_v(self, electrode: int) -> float:
        return self.read_v(electrode, self.others_anodic)

    def read_v(self, electrode: int, is_anodic: bool) -> float:
        """One probe."""
        return self._prober.probe(electrode, is_anodic)[1].voltage_v

    def is_load(self, volts: float) -> bool:
        return is_near_v(volts, self.load_v, self._source)

    def is_open(self, volts: float) -> bool:
        return is_near_v(volts, self._open_v, self._source)
