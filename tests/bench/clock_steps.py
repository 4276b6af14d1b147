"""What it costs when the clocks of a machine follow its load: pulses that were not fired, modelled.

Owns: the scene, what is counted of it, and its table. Must not know: bounds.
"""

from __future__ import annotations

from dataclasses import dataclass

from rich.table import Table

import engine_rig
from etd_hal.fake.faults import ClockSteps

ELECTRODES, RATE_HZ, WIDTH_US = 64, 30.0, 100
FACTORS = (1.3, 2.5)
EVERY_MS = (8, 30, 100)
_OPENS_MS = 500.0
_RUNS_S = 4.0


@dataclass(frozen=True)
class Steps:
    """A frame held for some seconds beside clocks that change."""

    factor: float
    every_ms: int
    #: Of the pulses that are fired beside clocks that are fixed.
    fired_percent: float
    widest_us: float
    recalibrated: int
    #: A speed that was known was recognized.
    recognized: int
    state: str


def measure(
    factor: float, every_ms: int, *, runs_s: float = _RUNS_S, are_at_start: bool = False
) -> Steps:
    """`are_at_start`: they change from the first calibration on, and not after some scans only."""
    steps = ClockSteps(factor, every_ms)
    rig = engine_rig.make(electrodes=ELECTRODES, faults=[steps] if are_at_start else [])
    rig.open()
    rig.arm()
    frame = {
        "current_ua": (400,) * ELECTRODES,
        "width_us": WIDTH_US,
        "rate_hz": RATE_HZ,
        "ttl_ms": 1_000,
    }
    rig.hold(_OPENS_MS, **frame)
    if not are_at_start:
        rig.fake.world.put_in(steps)
    since_ns = rig.clock.now_ns()
    while rig.state == "ARMED" and rig.clock.now_ns() - since_ns < runs_s * 1e9:
        rig.send(**frame)
        rig.run_ms(60)
    over_ns = since_ns + int(runs_s * 1e9)
    pulses = [pulse for pulse in rig.body() if since_ns <= pulse["from_ns"] < over_ns]
    counters, state = rig.engine.components.reporter.counters, rig.state
    rig.fake.world.mend()
    assert rig.close() == ()
    return Steps(
        factor,
        every_ms,
        100 * len(pulses) / (ELECTRODES * RATE_HZ * runs_s),
        max((pulse["to_ns"] - pulse["from_ns"]) / 1_000 for pulse in pulses),
        counters["recalibrated"],
        counters["clock_steps"],
        state,
    )


def measure_all() -> list[Steps]:
    return [measure(factor, every_ms) for factor in FACTORS for every_ms in EVERY_MS]


def table(found: list[Steps]) -> Table:
    """For people."""
    shown = Table(title=f"clocks that change: {ELECTRODES} electrodes at {RATE_HZ:g} Hz, modelled")
    columns = ("slower by", "every", "fired", "widest of 100 us", "calibrated", "recognized", "")
    for column in columns:
        shown.add_column(column, justify="right")
    for steps in found:
        shown.add_row(
            f"{steps.factor:g}",
            f"{steps.every_ms} ms",
            f"{steps.fired_percent:.1f} %",
            f"{steps.widest_us:.0f} us",
            str(steps.recalibrated),
            str(steps.recognized),
            steps.state,
        )
    return shown
