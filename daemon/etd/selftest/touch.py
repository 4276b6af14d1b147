"""One touch of the load: which electrodes read the load, open, or neither.

Owns: the figures that a reading is compared with, and the round over all other electrodes while the
touch is held. Must not know: instructions to the operator, checks.

The load's fixed end is on its first electrode. The electrode that the other end touches must read
the load, on the source and on ground; the fixed end reads it too, all others read open. The others
are probed in one polarity; a walk with another load has the other one.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from etd.selftest.fixture import DummyLoad, Fixture
from etd.selftest.prober import Prober
from etd.selftest.readings import NearerOf, is_near_v

#: Readings in both polarities: of the load before the walk, and during a touch. A second load may
#: be ten codes of the ADC: so many readings average the noise.
_READINGS_BEFORE, _READINGS = 8, 4


@dataclass(frozen=True, slots=True)
class Look:
    """The readings at the electrode asked for and, if it reads the load, at all others."""

    #: It reads the load in both polarities.
    answers: bool
    #: (source, ground)
    read_v: tuple[float, float]
    #: The other electrodes with a wrong reading, if the touch was held during their round.
    others: tuple[int, ...] = ()
    #: It still read the load after that round.
    is_held: bool = False

    @property
    def is_good(self) -> bool:
        return self.answers and self.is_held and not self.others


class Touch:
    """Made while only the load is connected, between its two electrodes."""

    def __init__(
        self, fixture: Fixture, prober: Prober, load: DummyLoad, *, others_anodic: bool = True
    ) -> None:
        """`others_anodic`: whether the others are probed on the source, or else on ground.

        Raises: BusError, BoardFault, GuardRefusal, as all methods.
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
        """One probe in each polarity; if it reads the load, more, and a round over all others."""
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
        """All that are not open, except this one and the fixed end."""
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
        """The mean of one look's readings, including the first ones."""
        more = [self._once_v(electrode) for _ in range(_READINGS - 1)]
        source_v, ground_v = zip(first_v, *more, strict=True)
        return statistics.mean(source_v), statistics.mean(ground_v)

    def _steady_v(self, electrode: int) -> float:
        return statistics.mean(self._in_round_v(electrode) for _ in range(_READINGS))

    def _in_round_v(self, electrode: int) -> float:
        return self.read_v(electrode, self.others_anodic)

    def read_v(self, electrode: int, is_anodic: bool) -> float:
        return self._prober.probe(electrode, is_anodic)[1].voltage_v

    def is_load(self, volts: float) -> bool:
        return is_near_v(volts, self.load_v, self._source)

    def is_open(self, volts: float) -> bool:
        return is_near_v(volts, self._open_v, self._source)
