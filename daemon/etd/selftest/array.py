"""Stage 6, imperceptible probes: the ramp up to the probe, and what is connected to the array.

Owns: what is concluded from probes of open electrodes. Must not know: how they are fired
(`prober.py`), the load.
"""

from __future__ import annotations

import statistics

from etd.selftest.buses import IDLE_V
from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.readings import Map, is_near_v, read_map


def check(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    if not check_ramp(fixture, log, prober, "ramp"):
        return
    found = read_map(fixture, prober)
    log.judge(
        "baseline",
        found.baseline_v <= IDLE_V,
        f"{found.baseline_v:.2f} V before a pulse",
        f"at most {IDLE_V} V",
        "check the source for an offset; the rest after a pulse may be too short",
    )
    check_alone(fixture, log, found, fixture.free, "nothing_else")


def check_ramp(
    fixture: Fixture, log: CheckLog, prober: Prober, name: str, is_supplied: bool = True
) -> bool:
    """Before the first probe while the supply may be on. Raises: as `check`."""
    ramp = prober.ramp(fixture.free[0], is_supplied)
    return log.judge(name, ramp.is_good, ramp.measured, ramp.expected, OPEN_ADVICE)


OPEN_ADVICE = (
    "disconnect everything from the electrodes; if nothing was connected, check full_scale_ua,"
    " leak_ohm and node_uv_per_code in the board file, and the rail"
)


def check_alone(fixture: Fixture, log: CheckLog, found: Map, free: list[int], name: str) -> bool:
    """All electrodes without the load read alike: open."""
    node_v = statistics.median(found.voltage_v[electrode] for electrode in free)
    source = fixture.file.source
    others = [
        electrode for electrode in free if not is_near_v(found.voltage_v[electrode], node_v, source)
    ]
    listed = ", ".join(
        f"{electrode} ({found.voltage_v[electrode]:.2f} V)" for electrode in others[:8]
    )
    return log.judge(
        name,
        not others,
        f"{len(others)} differ: {listed}" if others else f"{len(free)} electrodes are open",
        f"{node_v:.2f} V at each electrode without a load",
        "disconnect everything; a reading near 0 is a solder bridge, the same reading at many"
        " electrodes a latch or a chain that does not work",
    )
