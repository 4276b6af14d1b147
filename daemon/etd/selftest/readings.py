"""What readings of the node say: how sure a mean is, a load as a part of the leak, load or open.

Owns: the figures, and how far each may be off. Must not know: checks, stages, what follows of it.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from etd.selftest.fixture import Fixture
from etd.selftest.prober import Prober
from etd_hal.boardfile import Source

#: Of a measured against a named value: half of the 20 % that IEC 60601-2-10 asks of amplitudes.
TOLERANCE = 0.1
#: Probes that are weaker by such parts, so that they do not all round alike, so often; and what is
#: left then of the ADC's step, and of a noise of 1.5 codes.
_PARTS, _WEAKER_BY, _TIMES = 8, 32, 4
_STEP_LEFT = 0.25
#: What a single reading of an ADC in order may be off by chance.
_NOISE_CODES = 6
#: Rounds over the array for a map: a reading decides alone of none.
_ROUNDS = 2
#: Of the current, that must go through a load.
_LEAST_THROUGH = 0.05


@dataclass(frozen=True, slots=True)
class Map:
    """The node's voltage for each electrode alone against all others; all with one current."""

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
    """What was measured, and what it may be for the ADC's step."""

    value: float
    low: float
    high: float

    def is_near(self, named: float) -> bool:
        """Some of what it may be is within the tolerance of what was named."""
        return self.low <= named * (1 + TOLERANCE) and self.high >= named * (1 - TOLERANCE)


class Part(Measured):
    """A load as a part of the leak, by two readings of one current, whatever that is: a source
    that is off within its tolerance must not make another load of it.
    """

    __slots__ = ()

    @classmethod
    def of(cls, volts: float, open_v: float, left_v: float) -> Part | None:
        """Of the node beside the load, and open; None where the load cannot be told from none."""
        through_v = open_v - volts
        if through_v <= max(_LEAST_THROUGH * open_v, 2 * left_v):
            return None
        return cls(
            volts / through_v,
            max(0.0, volts - left_v) / (through_v + 2 * left_v),
            (volts + left_v) / (through_v - 2 * left_v),
        )

    def times(self, of: float) -> Measured:
        """The same part of a known leak, in its unit; or of what the leak takes."""
        return Measured(self.value * of, self.low * of, self.high * of)


@dataclass(frozen=True, slots=True)
class NearerOf:
    """Whether one reading is of the load or of an open node, by which it is nearer to: for what
    asks if a switch followed, and not how large something is.
    """

    load_v: float
    open_v: float
    step_v: float

    def is_load(self, volts: float) -> bool:
        """A node on ground is neither."""
        return self._least_v <= volts <= self._middle_v

    def is_open(self, volts: float) -> bool:
        return volts > self._middle_v

    @property
    def _middle_v(self) -> float:
        return (self.load_v + self.open_v) / 2

    @property
    def _least_v(self) -> float:
        return self.load_v / 2 - _NOISE_CODES * self.step_v


def mean_v(prober: Prober, electrode: int) -> tuple[float, float]:
    """(commanded_ua, V) of probes up to the weak one. Raises: BusError, BoardFault,
    GuardRefusal.
    """
    results = [
        prober.probe(electrode, current_ua=prober.probe_ua * (_WEAKER_BY - weaker) // _WEAKER_BY)
        for weaker in range(_PARTS)
        for _ in range(_TIMES)
    ]
    commanded_ua = statistics.mean(commanded_ua for commanded_ua, _ in results)
    return commanded_ua, statistics.mean(result.voltage_v for _, result in results)


def is_near_v(volts: float, expected_v: float, source: Source) -> bool:
    """Within the tolerance, and a step of the ADC."""
    return abs(volts - expected_v) <= TOLERANCE * expected_v + source.node_uv_per_code / 1e6


def left_v(source: Source) -> float:
    """What may be left of the ADC's step in a mean of `mean_v`."""
    return source.node_uv_per_code / 1e6 * _STEP_LEFT
