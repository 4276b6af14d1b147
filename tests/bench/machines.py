"""Scans on the modelled machines, their processor included: what a plan says, and what comes of it.

Owns: which machines, boards and rests, and the figures from the bus trace. Must not know: tables,
bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import msgspec

import engine_rig
from bench.modelled import CURRENT_UA, WIDTH_US
from engine_scenes import opened_to
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.errors import TimePart
from etd_hal.fake.machines import MACHINES
from etd_hal.fake.processor import StagedTime

#: Electrodes, and rest.
SCENES = ((64, 200), (64, 50), (128, 200), (256, 200))
_LARGEST_KIT = 64
_RATE_HZ = 100.0
#: Longer than the scans that still have the sleep of before in their window.
_SETTLED_NS = 200_000_000


@dataclass(frozen=True)
class MachineScan:
    """`planned_hz`: what the reply says is possible. `period_ms`: what then came, from scan to
    scan, the processor's pauses included.
    """

    machine: str
    electrodes: int
    rest_us: int
    computing_us: float
    planned_hz: float
    bound_by: TimePart | None
    period_ms: float
    limit_ms: float

    @property
    def ratio(self) -> float:
        return self.period_ms / self.limit_ms

    @property
    def kept(self) -> float:
        """The rate that came, over the rate that was planned."""
        return 1e3 / self.period_ms / self.planned_hz


def measure(machine: str, electrodes: int, rest_us: int) -> MachineScan:
    """The first `electrodes` of the chain, as fast as the plan lets them."""
    loaded, model = _loaded(machine, electrodes, rest_us), MACHINES[machine]
    rig = engine_rig.make(loaded=loaded, processor=StagedTime(model.slowness), machine=model)
    rig.open(width_us=WIDTH_US)
    rig.arm()
    opened_to(rig, CURRENT_UA)
    wanted = tuple(CURRENT_UA * (output < electrodes) for output in loaded.array.outputs())
    begun_ns = rig.clock.now_ns()
    answer = rig.show(
        current_ua=wanted, width_us=WIDTH_US, rate_hz=_RATE_HZ, allow_slower=True, ttl_ms=1_000
    )
    rig.run_ms(970)
    first = loaded.array.outputs().index(0)
    starts_ns = [
        phase.from_ns
        for phase in rig.followed.phases()
        if phase.electrode == first and phase.from_ns - begun_ns > _SETTLED_NS
    ]
    period_ms = (starts_ns[-1] - starts_ns[0]) / (len(starts_ns) - 1) / 1e6
    computing_us = rig.engine.components.computing.pulse_us
    assert rig.close() == ()
    assert answer.rate_hz is not None, answer.reason
    return MachineScan(
        machine,
        electrodes,
        rest_us,
        computing_us,
        answer.rate_hz,
        answer.slowed[0].bound_by if answer.slowed else None,
        period_ms,
        electrodes * (WIDTH_US + rest_us) / 1e3,
    )


def _loaded(machine: str, electrodes: int, rest_us: int) -> LoadedConfig:
    if electrodes > _LARGEST_KIT:
        loaded = fake_config("etactilekit-hv513-x8", "grid-16x16", machine=machine)
    else:
        loaded = fake_config("kajimoto-hv507", electrodes=electrodes, machine=machine)
    return replace(loaded, board=msgspec.structs.replace(loaded.board, rest_us=rest_us))
