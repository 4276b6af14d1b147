"""Stage 8, imperceptible probes: the source with nothing connected, and whether the load is the one
that was named.

Owns: what is concluded from probes. Must not know: how they are fired (`prober.py`), the
uncertainty of a reading (`readings.py`).

With nothing connected the node rises to current x leak; with a known load it rises less. The two
readings together give leak and current, so that a wrong gain and a wrong leak can be distinguished.
"""

from __future__ import annotations

import statistics

from etd.selftest.array import OPEN_ADVICE
from etd.selftest.fixture import LOAD_OPTIONS, DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.readings import (
    TOLERANCE,
    Measured,
    NearerOf,
    Part,
    is_near_v,
    left_v,
    mean_v,
    read_map,
)
from etd_hal.boardfile import Relays

#: Of the named load's reading: a short circuit says nothing about the constants.
_LEAST_OF_LOAD = 0.5


def check(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    load, free = fixture.options.load, fixture.free
    _check_open(fixture, log, prober, free)
    if load is None:
        for name in ("load_agrees", "leak", "ua_per_code", "blanked", "latch_holds"):
            log.skip(name, "no dummy load", LOAD_OPTIONS)
    else:
        _check_load(fixture, log, prober, load, free[0])


def _check_open(fixture: Fixture, log: CheckLog, prober: Prober, free: list[int]) -> None:
    found = read_map(fixture, prober)
    expected_v = prober.open_v(found.commanded_ua)
    node_v = statistics.median(found.voltage_v[electrode] for electrode in free)
    log.judge(
        "open_signature",
        is_near_v(node_v, expected_v, fixture.file.source),
        f"{node_v:.2f} V at {found.commanded_ua} uA",
        f"{expected_v:.2f} V +-{TOLERANCE:.0%}: current x leak with nothing connected",
        OPEN_ADVICE,
    )


def _check_load(
    fixture: Fixture, log: CheckLog, prober: Prober, load: DummyLoad, free: int
) -> None:
    """With the weak probe, since the load is not confirmed yet: open, then from both its ends."""
    commanded_ua, open_v = mean_v(prober, free)
    ends_v = [mean_v(prober, electrode)[1] for electrode in (load.first, load.second)]
    ohm = load.resistance_ohm
    left = left_v(fixture.file.source)
    parts = [Part.of(volts, open_v, left) for volts in ends_v]
    leak_ohm = fixture.file.source.leak_ohm
    agrees = log.judge(
        "load_agrees",
        all(part is not None and part.times(leak_ohm).is_near(ohm) for part in parts),
        " and ".join(
            "open" if part is None else f"{part.times(leak_ohm).value:.0f} ohm" for part in parts
        ),
        f"{ohm} ohm +-{TOLERANCE:.0%} at electrodes {load.first} and {load.second}",
        "measure the resistor and check its place; if both are right, leak_ohm in the board file is"
        " wrong for this board",
    )
    volts = statistics.mean(ends_v)
    part = Part.of(volts, open_v, left)
    load_v = commanded_ua / 1e6 / (1 / ohm + 1 / leak_ohm)
    if part is None or volts < load_v * _LEAST_OF_LOAD:
        return
    _check_constants(fixture, log, commanded_ua, open_v, part, ohm)
    if agrees:
        _check_blanked(fixture, log, prober, load, open_v / commanded_ua)
        _check_latch(fixture, log, prober, load, free, (volts, open_v))
    fixture.is_load_confirmed = agrees and not log.stage_failed


def _check_blanked(
    fixture: Fixture, log: CheckLog, prober: Prober, load: DummyLoad, open_v_per_ua: float
) -> None:
    """With either end of the load in the chain, and nothing connected."""
    fired = [prober.blanked(electrode) for electrode in (load.first, load.second)]
    ends_v = [result.voltage_v for _, result in fired]
    open_v = open_v_per_ua * fired[0][0]
    log.judge(
        "blanked",
        all(is_near_v(volts, open_v, fixture.file.source) for volts in ends_v),
        " and ".join(f"{volts:.2f} V" for volts in ends_v),
        f"{open_v:.2f} V with the load's electrodes selected and the outputs blanked: open",
        "the electrodes are not switched off: BL is stuck beyond the pin (a level shifter, a"
        " shorted wire), or a relay sticks",
    )


def _check_latch(
    fixture: Fixture,
    log: CheckLog,
    prober: Prober,
    load: DummyLoad,
    free: int,
    means_v: tuple[float, float],
) -> None:
    """With an end of the load latched, an open electrode is shifted in. A latch that is stuck open
    would pass every word while it is shifted, and any glitch of the clock.

    `means_v`: of the load, and open, by slightly weaker probes.
    """
    if isinstance(fixture.file.switch, Relays):
        log.absent("latch_holds", "relay drivers latch at an edge of LE: there is no open state")
        return
    ends = (load.first, load.second)
    held_v = [prober.latched(end, behind=free)[1].voltage_v for end in ends]
    expected = NearerOf(*means_v, fixture.file.source.node_uv_per_code / 1e6)
    log.judge(
        "latch_holds",
        all(expected.is_load(volts) for volts in held_v),
        " and ".join(f"{volts:.2f} V" for volts in held_v),
        f"nearer to {means_v[0]:.2f} than to {means_v[1]:.2f} V with the load's electrodes latched"
        f" and electrode {free} shifted in behind",
        "LE is stuck at its open level beyond the pin (a level shifter, a shorted wire)",
    )


def _check_constants(
    fixture: Fixture, log: CheckLog, commanded_ua: float, open_v: float, part: Part, ohm: int
) -> None:
    source = fixture.file.source
    leak_ohm = Measured(ohm / part.value, ohm / part.high, ohm / part.low)
    made_ua = part.times(open_v / ohm * 1e6)
    log.judge(
        "leak",
        leak_ohm.is_near(source.leak_ohm),
        f"{leak_ohm.value:.0f} ohm",
        f"{source.leak_ohm} ohm +-{TOLERANCE:.0%}",
        "put the measured figure into leak_ohm of your own board file",
    )
    log.judge(
        "ua_per_code",
        made_ua.is_near(commanded_ua),
        f"{made_ua.value:.0f} uA where {commanded_ua:.0f} uA were commanded",
        f"+-{TOLERANCE:.0%}",
        f"if the divider (node_uv_per_code) is right, full_scale_ua of this board is about"
        f" {source.full_scale_ua * made_ua.value / commanded_ua:.0f}: put that into your own board"
        " file",
    )
    fixture.leak_ohm = leak_ohm.value
    fixture.gain = made_ua.value / commanded_ua
