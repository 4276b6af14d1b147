"""Stage 6, imperceptible probes: the source's signature, what is connected, and whether the load
that was named is the one that is there.

Owns: what is concluded from probes. Must not know: how they are fired (`prober.py`), how sure a
reading is (`readings.py`).

With nothing connected the node rises to current x leak. Beside a known load the same current
makes less, and the two together give leak and current apart: that is how a wrong gain and a wrong
leak are told from each other.
"""

from __future__ import annotations

import statistics

from etd.selftest.bed import LOAD_OPTIONS, Bed, DummyLoad
from etd.selftest.buses import IDLE_V
from etd.selftest.log import Log
from etd.selftest.prober import Prober
from etd.selftest.readings import (
    TOLERANCE,
    Map,
    Measured,
    NearerOf,
    Part,
    is_near_v,
    left_v,
    mean_v,
    read_map,
)
from etd_hal.boardfile import Relays

#: Of what the named load would read; a short is no load, and says nothing of the constants.
_LEAST_OF_LOAD = 0.5


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
    node_v = statistics.median(found.voltage_v[one] for one in free)
    log.judge(
        "open_signature",
        is_near_v(node_v, expected_v, bed.file.source),
        f"{node_v:.2f} V at {found.told_ua} uA",
        f"{expected_v:.2f} V +-{TOLERANCE:.0%}: current x leak with nothing connected",
        _OPEN_ADVICE,
    )


def check_alone(bed: Bed, log: Log, found: Map, free: list[int], name: str) -> bool:
    """All electrodes but the load's are open, as open as the most of them."""
    node_v = statistics.median(found.voltage_v[one] for one in free)
    source = bed.file.source
    others = [one for one in free if not is_near_v(found.voltage_v[one], node_v, source)]
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
    left = left_v(bed.file.source)
    parts = [Part.of(volts, open_v, left) for volts in ends_v]
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
    part = Part.of(volts, open_v, left)
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
    log.judge(
        "blanked",
        all(is_near_v(volts, open_v, bed.file.source) for volts in ends_v),
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
    bed: Bed, log: Log, told_ua: float, open_v: float, part: Part, ohm: int
) -> None:
    source = bed.file.source
    leak_ohm = Measured(ohm / part.value, ohm / part.high, ohm / part.low)
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
