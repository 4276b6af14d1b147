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

#: Of a measured against a named value: half of the 20 % that IEC 60601-2-10 asks of amplitudes.
TOLERANCE = 0.1
#: A few readings of the same are averaged; the ADC's step is what is left.
_READINGS = 4
#: Of what the named load would read; a short is no load, and says nothing of the constants.
_LEAST_OF_LOAD = 0.5


@dataclass(frozen=True, slots=True)
class Map:
    """The node's voltage for each electrode alone against all others; all with one current."""

    told_ua: int
    voltage_v: tuple[float, ...]
    baseline_v: float


def read_map(bed: Bed, prober: Prober) -> Map:
    """One probe at each electrode. Raises: BusError, BoardFault, GuardRefusal."""
    shots = []
    told_ua = 0
    for electrode in range(bed.loaded.array.count):
        told_ua, shot = prober.probe(electrode)
        shots.append(shot)
    return Map(
        told_ua, tuple(shot.voltage_v for shot in shots), max(shot.baseline_v for shot in shots)
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
        for name in ("load_agrees", "leak", "ua_per_code", "blanked"):
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
    told_ua, open_v = _mean_v(prober, free)
    ends_v = [_mean_v(prober, one)[1] for one in (load.first, load.second)]
    ohm = load.resistance_ohm
    found_ohm = [_resistance_ohm(bed, told_ua, volts) for volts in ends_v]
    agrees = log.judge(
        "load_agrees",
        all(one is not None and abs(one - ohm) <= TOLERANCE * ohm for one in found_ohm),
        " and ".join("open" if one is None else f"{one:.0f} ohm" for one in found_ohm),
        f"{ohm} ohm +-{TOLERANCE:.0%} at electrodes {load.first} and {load.second}",
        "measure the resistor and look where it is; if both are right, the leak or the source's"
        " full scale in the board file is not this board's",
    )
    volts = statistics.mean(ends_v)
    load_v = told_ua / 1e6 / (1 / ohm + 1 / bed.file.source.leak_ohm)
    if not load_v * _LEAST_OF_LOAD < volts < open_v * (1 - TOLERANCE / 2):
        return
    _check_constants(bed, log, told_ua, open_v, volts, ohm)
    if agrees:
        _check_blanked(bed, log, prober, load, open_v)
    bed.is_load_confirmed = agrees and not log.stage_failed


def _check_blanked(bed: Bed, log: Log, prober: Prober, load: DummyLoad, open_v: float) -> None:
    """With either end of the load in the chain, and nothing connected."""
    ends_v = [prober.blanked(one)[1].voltage_v for one in (load.first, load.second)]
    slack_v = TOLERANCE * open_v + bed.file.source.node_uv_per_code / 1e6
    log.judge(
        "blanked",
        all(abs(volts - open_v) <= slack_v for volts in ends_v),
        " and ".join(f"{volts:.2f} V" for volts in ends_v),
        f"{open_v:.2f} V with the load's electrodes selected and the outputs blanked: open",
        "nothing switches the electrodes off: BL stands at its level beyond the pin (a level"
        " shifter, a shorted wire), or a relay sticks",
    )


def _check_constants(
    bed: Bed, log: Log, told_ua: float, open_v: float, volts: float, ohm: int
) -> None:
    source = bed.file.source
    leak_ohm = ohm * (open_v / volts - 1)
    made_ua = open_v / leak_ohm * 1e6
    log.judge(
        "leak",
        abs(leak_ohm - source.leak_ohm) <= TOLERANCE * source.leak_ohm,
        f"{leak_ohm:.0f} ohm",
        f"{source.leak_ohm} ohm +-{TOLERANCE:.0%}",
        "put the measured figure into leak_ohm of a board file of yours",
    )
    log.judge(
        "ua_per_code",
        abs(made_ua - told_ua) <= TOLERANCE * told_ua,
        f"{made_ua:.0f} uA, where {told_ua} uA were told",
        f"+-{TOLERANCE:.0%}",
        f"if the divider (node_uv_per_code) is right, full_scale_ua of this board is about"
        f" {source.full_scale_ua * made_ua / told_ua:.0f}: put that into a board file of yours",
    )
    bed.leak_ohm = leak_ohm


def _mean_v(prober: Prober, electrode: int) -> tuple[int, float]:
    shots = [prober.probe(electrode) for _ in range(_READINGS)]
    return shots[0][0], statistics.mean(shot.voltage_v for _, shot in shots)


def _resistance_ohm(bed: Bed, told_ua: float, volts: float) -> float | None:
    """By the board file's constants; None where the leak takes it all."""
    through_ua = told_ua - volts / bed.file.source.leak_ohm * 1e6
    return volts / through_ua * 1e6 if through_ua > 0.02 * told_ua else None
