"""Scans on the modelled machines, their processor included: what a plan says, and what comes of it.

Owns: which machines, boards and rests, how the code and the kernel are modelled, and the figures
from the bus trace. Must not know: tables, bounds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import msgspec

import engine_rig
from bench.modelled import CURRENT_UA, WIDTH_US
from engine_scenes import opened_to
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.errors import TimePart
from etd_hal.bench import UNKNOWN_CORE, ScanCore
from etd_hal.fake.machines import MACHINES
from etd_hal.fake.processor import COMPILED_STAGES_NS, STAGES_NS, Stage, StagedTime

#: Electrodes, and rest.
SCENES = ((64, 200), (64, 50), (128, 200), (256, 200))
#: Interpreted or compiled code.
Code = Literal["interpreted", "compiled"]
#: Whether the kernel is known to leave the scan's core alone.
Kernel = Literal["not known", "both off"]
_STAGES_NS: Mapping[Code, Mapping[Stage, int]] = {
    "interpreted": STAGES_NS,
    "compiled": COMPILED_STAGES_NS,
}
_CORES: Mapping[Kernel, ScanCore] = {
    "not known": UNKNOWN_CORE,
    "both off": ScanCore(3, is_isolated=True, has_throttle=False, has_fair_server=False),
}
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
    code: Code
    kernel: Kernel
    electrodes: int
    rest_us: int
    spun_us: float
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

    @property
    def is_the_fastest_pi4(self) -> bool:
        """Compiled code, on a core that the kernel is known to leave alone."""
        return (self.machine, self.code, self.kernel) == ("pi4", "compiled", "both off")

    def __str__(self) -> str:
        return (
            f"{self.machine}, {self.code}, kernel {self.kernel}, {self.electrodes} electrodes, rest"
            f" {self.rest_us} us"
        )


def measure_all(scenes: int | None) -> Iterator[MachineScan]:
    """On each machine so many of the scenes, with each code and each kernel."""
    for machine in MACHINES:
        for electrodes, rest_us in SCENES[:scenes]:
            for code in _STAGES_NS:
                for kernel in _CORES:
                    yield measure(machine, electrodes, rest_us, code, kernel)


def measure(machine: str, electrodes: int, rest_us: int, code: Code, kernel: Kernel) -> MachineScan:
    """The first `electrodes` of the chain, as fast as the plan lets them."""
    loaded, model = _loaded(machine, electrodes, rest_us), MACHINES[machine]
    processor = StagedTime(model.slowness, _STAGES_NS[code])
    # The rig's gateway says that it is there between two scans only, and one may last 250 ms.
    rig = engine_rig.make(
        loaded=loaded,
        processor=processor,
        machine=model,
        wrap=lambda backend: replace(backend, timeout_factor=4),
    )
    rig.fake.world.host.modelled_core = _CORES[kernel]
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
    computing = rig.engine.components.computing
    assert rig.close() == ()
    assert answer.rate_hz is not None, answer.reason
    return MachineScan(
        machine,
        code,
        kernel,
        electrodes,
        rest_us,
        computing.spun_us,
        computing.pulse_us,
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
