"""Stage 6, imperceptible probes: the source's signature, what is connected, and whether the load
that was named is the one that is there.

Owns: what is concluded from probes. Must not know: how they are fired (`prober.py`).

With nothing connected the node rises to current x leak. Beside a known load the same current
makes less, and the two together give leak and current apart: that is how a wrong gain and a wrong
leak are told from each other.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from etd.selftest.bed import LOAD_OPTIONS, Bed, DummyLoad
from etd.selftest.buses import IDLE_V
from etd.selftest.log import Log
from etd.selftest.prober import Prober
from etd_hal.boardfile import Relays

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
#: Of what the named load would read; a short is no load, and says nothing of the constants.
_LEAST_OF_LOAD = 0.5
#: Of the current, that must go through a load.
_LEAST_THROUGH = 0.05


@dataclass(frozen=True, slots=True)
class Map:
    """The node's voltage for each electrode alone against all others; all with one current."""

    told_ua: int
    voltage_v: tuple[float, ...]
    baseline_v: float


def read_map(bed: Bed, prober: Prober) -> Map:
    """The mean of a probe a round at each electrode. Raises: BusError, BoardFault, GuardRefusal."""
    electrodes = range(bed.loaded.array.count)
    rounds = [[prober.probe(one) for one in electrodes] for _ in range(_ROUNDS)]
    shots = [[shot for _, shot in one_round] for one_round in rounds]
    return Map(
        rounds[0][0][0],
        tuple(
            statistics.mean(shot.voltage_v for shot in both) for both in zip(*shots, strict=True)
        ),
        max(shot.baseline_v for one_round in shots for shot in one_round),
    )


def check(bed: Bed, log: Log, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    load, free = bed.asked.load, bed.free
    if not check_ramp(bed, log, prober, "ramp"):
        return
    found = read_map(bed, prober)
    log.judge(
        "baseline",
        found.baseline_v <= IDLE_V,
        f"{found.baseline_v:.2f} V before a pulse",
        f"at most {IDLE_V} V",
        "the source has an offset, or the rest after a pulse is too short",
    )
    _check_open(bed, log, prober, found, free)
    is_alone = check_alone(bed, log, found, free, "nothing_else")
    if load is None:
        for name in ("load_agrees", "leak", "ua_per_code", "blanked", "latch_holds"):
            log.skip(name, "no load was named", LOAD_OPTIONS)
    elif is_alone:
        _check_load(bed, log, prober, load, free[0])


def check_ramp(bed: Bed, log: Log, prober: Prober, name: str, is_supplied: bool = True) -> bool:
    """Before the first probe with a supply that may be there. Raises: as `check`."""
    ramp = prober.ramp(bed.free[0], is_supplied)
    return log.judge(name, ramp.is_good, ramp.measured, ramp.expected, _OPEN_ADVICE)


_OPEN_ADVICE = (
    "take everything off the electrodes; if nothing is there, full_scale_ua, leak_ohm or"
    " node_uv_per_code of the board file is not this board's, or the rail is not there"
)


def _check_open(bed: Bed, log: Log, prober: Prober, found: Map, free: list[int]) -> None:
    expected_v = prober.open_v(found.told_ua)
    step_v = bed.file.source.node_uv_per_code / 1e6
    node_v = statistics.median(found.voltage_v[one] for one in free)
    log.judge(
        "open_signature",
        abs(node_v - expected_v) <= TOLERANCE * expected_v + step_v,
        f"{node_v:.2f} V at {found.told_ua} uA",
        f"{expected_v:.2f} V +-{TOLERANCE:.0%}: current x leak with nothing connected",
        _OPEN_ADVICE,
    )


def check_alone(bed: Bed, log: Log, found: Map, free: list[int], name: str) -> bool:
    """All electrodes but the load's are open, as open as the most of them."""
    node_v = statistics.median(found.voltage_v[one] for one in free)
    slack_v = TOLERANCE * node_v + bed.file.source.node_uv_per_code / 1e6
    others = [one for one in free if abs(found.voltage_v[one] - node_v) > slack_v]
    listed = ", ".join(f"{one} ({found.voltage_v[one]:.2f} V)" for one in others[:8])
    return log.judge(
        name,
        not others,
        f"{len(others)} differ: {listed}" if others else f"{len(free)} electrodes are open",
        f"{node_v:.2f} V at each electrode without a load",
        "take everything off; a reading near 0 is a bridge of solder, one that is shared by many"
        " is a latch or a chain that does not follow",
    )


def _check_load(bed: Bed, log: Log, prober: Prober, load: DummyLoad, free: int) -> None:
    """Still with the weak probe, since the load is only said to be there: open, then from either
    end of it.
    """
    told_ua, open_v = mean_v(prober, free)
    ends_v = [mean_v(prober, one)[1] for one in (load.first, load.second)]
    ohm = load.resistance_ohm
    left_v = bed.file.source.node_uv_per_code / 1e6 * _STEP_LEFT
    parts = [_Part.of(volts, open_v, left_v) for volts in ends_v]
    leak_ohm = bed.file.source.leak_ohm
    agrees = log.judge(
        "load_agrees",
        all(part is not None and part.times(leak_ohm).is_near(ohm) for part in parts),
        " and ".join(
            "open" if part is None else f"{part.times(leak_ohm).value:.0f} ohm" for part in parts
        ),
        f"{ohm} ohm +-{TOLERANCE:.0%} at electrodes {load.first} and {load.second}",
        "measure the resistor and look where it is; if both are right, the leak in the board file"
        " is not this board's",
    )
    volts = statistics.mean(ends_v)
    part = _Part.of(volts, open_v, left_v)
    load_v = told_ua / 1e6 / (1 / ohm + 1 / leak_ohm)
    if part is None or volts < load_v * _LEAST_OF_LOAD:
        return
    _check_constants(bed, log, told_ua, open_v, part, ohm)
    if agrees:
        _check_blanked(bed, log, prober, load, open_v / told_ua)
        _check_latch(bed, log, prober, load, free, (volts, open_v))
    bed.is_load_confirmed = agrees and not log.stage_failed


def _check_blanked(
    bed: Bed, log: Log, prober: Prober, load: DummyLoad, open_v_per_ua: float
) -> None:
    """With either end of the load in the chain, and nothing connected."""
    fired = [prober.blanked(one) for one in (load.first, load.second)]
    ends_v = [shot.voltage_v for _, shot in fired]
    open_v = open_v_per_ua * fired[0][0]
    slack_v = TOLERANCE * open_v + bed.file.source.node_uv_per_code / 1e6
    log.judge(
        "blanked",
        all(abs(volts - open_v) <= slack_v for volts in ends_v),
        " and ".join(f"{volts:.2f} V" for volts in ends_v),
        f"{open_v:.2f} V with the load's electrodes selected and the outputs blanked: open",
        "nothing switches the electrodes off: BL stands at its level beyond the pin (a level"
        " shifter, a shorted wire), or a relay sticks",
    )


def _check_latch(
    bed: Bed,
    log: Log,
    prober: Prober,
    load: DummyLoad,
    free: int,
    means_v: tuple[float, float],
) -> None:
    """An end of the load in the latch, an open electrode in the chain behind it. A latch that stays
    open shows each word while it is shifted, and a glitch of the clock is a selection at once.

    `means_v`: of the load, and open, of somewhat weaker probes.
    """
    if isinstance(bed.file.switch, Relays):
        log.absent("latch_holds", "relays copy at an edge of LE: it has no open state")
        return
    ends = (load.first, load.second)
    held_v = [prober.latched(one, behind=free)[1].voltage_v for one in ends]
    expected = NearerOf(*means_v, bed.file.source.node_uv_per_code / 1e6)
    log.judge(
        "latch_holds",
        all(expected.is_load(volts) for volts in held_v),
        " and ".join(f"{volts:.2f} V" for volts in held_v),
        f"nearer to {means_v[0]:.2f} than to {means_v[1]:.2f} V with the load's electrodes latched"
        f" and electrode {free} shifted in behind",
        "LE stands at its open level beyond the pin (a level shifter, a shorted wire)",
    )


def _check_constants(
    bed: Bed, log: Log, told_ua: float, open_v: float, part: _Part, ohm: int
) -> None:
    source = bed.file.source
    leak_ohm = _Reading(ohm / part.value, ohm / part.high, ohm / part.low)
    made_ua = part.times(open_v / ohm * 1e6)
    log.judge(
        "leak",
        leak_ohm.is_near(source.leak_ohm),
        f"{leak_ohm.value:.0f} ohm",
        f"{source.leak_ohm} ohm +-{TOLERANCE:.0%}",
        "put the measured figure into leak_ohm of a board file of yours",
    )
    log.judge(
        "ua_per_code",
        made_ua.is_near(told_ua),
        f"{made_ua.value:.0f} uA, where {told_ua:.0f} uA were told",
        f"+-{TOLERANCE:.0%}",
        f"if the divider (node_uv_per_code) is right, full_scale_ua of this board is about"
        f" {source.full_scale_ua * made_ua.value / told_ua:.0f}: put that into a board file of"
        " yours",
    )
    bed.leak_ohm = leak_ohm.value
    bed.gain = made_ua.value / told_ua


@dataclass(frozen=True, slots=True)
class _Reading:
    """What was measured, and what it may be for the ADC's step."""

    value: float
    low: float
    high: float

    def is_near(self, named: float) -> bool:
        return self.low <= named * (1 + TOLERANCE) and self.high >= named * (1 - TOLERANCE)


class _Part(_Reading):
    """A load as a part of the leak, by two readings of one current, whatever that is: a source
    that is off within its tolerance must not make another load of it.
    """

    __slots__ = ()

    @classmethod
    def of(cls, volts: float, open_v: float, left_v: float) -> _Part | None:
        """Of the node beside the load, and open; None where the load cannot be told from none."""
        through_v = open_v - volts
        if through_v <= max(_LEAST_THROUGH * open_v, 2 * left_v):
            return None
        return cls(
            volts / through_v,
            max(0.0, volts - left_v) / (through_v + 2 * left_v),
            (volts + left_v) / (through_v - 2 * left_v),
        )

    def times(self, of: float) -> _Reading:
        return _Reading(self.value * of, self.low * of, self.high * of)


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
    """(told_ua, V) of probes up to the weak one. Raises: as `check`."""
    shots = [
        prober.probe(electrode, current_ua=prober.probe_ua * (_WEAKER_BY - weaker) // _WEAKER_BY)
        for weaker in range(_PARTS)
        for _ in range(_TIMES)
    ]
    told_ua = statistics.mean(told_ua for told_ua, _ in shots)
    return told_ua, statistics.mean(shot.voltage_v for _, shot in shots)
