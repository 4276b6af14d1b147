"""Readings of the node: the uncertainty of a mean, a load relative to the leak, load or open.

Owns: the figures and their tolerances. Must not know: checks, stages.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from etd.selftest.fixture import Fixture
from etd.selftest.prober import Prober
from etd_hal.boardfile import Source

#: Between a measured and a named value: half of the 20 % that IEC 60601-2-10 allows amplitudes.
TOLERANCE = 0.1
#: A mean is of 8 strengths, each 1/32 weaker than the one before so that rounding differs, 4 times
#: each; and what then remains of the ADC's step, and of a noise of 1.5 codes.
_PARTS, _WEAKER_BY, _TIMES = 8, 32, 4
_STEP_LEFT = 0.25
#: The noise of a single reading of a good ADC.
_NOISE_CODES = 6
#: Rounds over the array for a map: no single reading decides.
_ROUNDS = 2
#: The part of the current that must pass through a load.
_LEAST_THROUGH = 0.05


@dataclass(frozen=True, slots=True)
class Map:
    """The node's voltage for each electrode, alone against all others; of one current."""

    commanded_ua: int
    voltage_v: tuple[float, ...]
    baseline_v: float


def read_map(fixture: Fixture, prober: Prober) -> Map:
    """The mean of a probe a round at each electrode. Raises: BusError, BoardFault, GuardRefusal."""
    electrodes = range(fixture.loaded.array.count)
    rounds = [[prober.probe(electrode) for electrode in electrodes] for _ in range(_ROUNDS)]
    results = [[result for _, result in one_round] for one_round in rounds]
    return Map(
        rounds[0][0][0],
        tuple(
            statistics.mean(shot.voltage_v for shot in both) for both in zip(*results, strict=True)
        ),
        max(result.baseline_v for one_round in results for result in one_round),
    )


@dataclass(frozen=True, slots=True)
class Measured:
    """A measured value, and its range by the ADC's resolution."""

    value: float
    low: float
    high: float

    def is_near(self, named: float) -> bool:
        """The range overlaps the named value's tolerance."""
        return self.low <= named * (1 + TOLERANCE) and self.high >= named * (1 - TOLERANCE)


class Part(Measured):
    """A load relative to the leak, from two readings of one current, whose value cancels out."""

    __slots__ = ()

    @classmethod
    def of(cls, volts: float, open_v: float, left_v: float) -> Part | None:
        """From the node with the load and open; None if the load cannot be distinguished."""
        through_v = open_v - volts
        if through_v <= max(_LEAST_THROUGH * open_v, 2 * left_v):
            return None
        return cls(
            volts / through_v,
            max(0.0, volts - left_v) / (through_v + 2 * left_v),
            (volts + left_v) / (through_v - 2 * left_v),
        )

    def times(self, of: float) -> Measured:
        """Scaled by a known leak (or the current through it), in its unit."""
        return Measured(self.value * of, self.low * of, self.high * of)


@dataclass(frozen=True, slots=True)
class NearerOf:
    """Whether a reading is nearer to the load or to an open node: tells switches, not values."""

    load_v: float
    open_v: float
    step_v: float

    def is_load(self, volts: float) -> bool:
        """A node on ground is neither."""
        least_v = self.load_v / 2 - _NOISE_CODES * self.step_v
        return least_v <= volts <= self._middle_v

    def is_open(self, volts: float) -> bool:
        return volts > self._middle_v

    @property
    def _middle_v(self) -> float:
        return (self.load_v + self.open_v) / 2


def mean_v(prober: Prober, electrode: int) -> tuple[float, float]:
    """(commanded_ua, V), probes up to the weak one. Raises: BusError, BoardFault, GuardRefusal."""
    results = [
        prober.probe(electrode, current_ua=prober.probe_ua * (_WEAKER_BY - weaker) // _WEAKER_BY)
        for weaker in range(_PARTS)
        for _ in range(_TIMES)
    ]
    commanded_ua = statistics.mean(commanded_ua for commanded_ua, _ in results)
    return commanded_ua, statistics.mean(result.voltage_v for _, result in results)


def is_near_v(volts: float, expected_v: float, source: Source) -> bool:
    """Within the tolerance plus a step of the ADC."""
    return abs(volts - expected_v) <= TOLERANCE * expected_v + source.node_uv_per_code / 1e6


def left_v(source: Source) -> float:
    """The uncertainty of `mean_v` by the ADC's step."""
    return source.node_uv_per_code / 1e6 * _STEP_LEFT
