"""From a frame's stamp to its first pulse on a modelled machine, stage by stage.

Owns: the engine's part in stepped time with its computing, what is charged for all before it
(`front.py`), both together, their bounds, and the table. Must not know: how the front is measured.

It is the same in every run: frames come at times spread over the engine's tick, or over a scan's
period, from a generator with a seed. Waking up a process takes no time here, and nothing scatters
but the time at which a frame comes.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from rich.table import Table

import engine_rig
from bench.front import CHARGED_US, Front, at, currents
from bench.modelled import WIDTH_US, loaded_with
from engine_rig import LEASE, EngineRig
from engine_scenes import opened_to, shown
from etd.protocol.frame import Frame
from etd.protocol.link import NewFrame
from etd_hal.fake.machines import PI4
from etd_hal.fake.processor import (
    COMPILED_STAGES_NS,
    STAGES_NS,
    Call,
    Stage,
    StagedTime,
    Stages,
)

STAGES = ("wait", "plan", "pulse")
CONFIGURATIONS: Mapping[str, Mapping[Stage, int]] = {
    "interpreted": STAGES_NS,
    "compiled": COMPILED_STAGES_NS,
}
ELECTRODES_IN_USE = (1, 64)
#: The display is silent before each frame; a frame stands, and another comes; frames come as fast
#: as the slowest part of the front lets them.
Load = Literal["silent", "standing", "flooded"]
LOADS: tuple[Load, ...] = ("silent", "standing", "flooded")
RATE_HZ = 20.0
#: The most for the median, and beyond one scan for 99 of 100.
MOST_MS = 1.0
#: Where the median keeps it. Interpreted, the plan of 64 electrodes alone takes 0.8 ms.
MEETS = {("interpreted", 1), ("compiled", 1), ("compiled", 64)}
_REST_US = 200
_CEILING_UA = 1_000
_WARM_UP = 5
#: Longer than any scan.
_PAUSE_MS = 60
_MS = 1_000_000


@dataclass(frozen=True)
class Latency:
    """Of each frame that was shown, in us: from its stamp to its first pulse. `wait`: until the
    poll that reads it, and for a scan under way; `plan`: that poll and the plan; `pulse`: from the
    start of its scan to its first pulse.
    """

    configuration: str
    electrodes: int
    load: Load
    #: Client, sockets, gateway and link.
    front_us: float
    #: By frame, in the order of `STAGES`.
    frames: tuple[tuple[float, ...], ...]

    def part_us(self, stage: str, fraction: float) -> float:
        place = STAGES.index(stage)
        return at(fraction, [frame[place] for frame in self.frames])

    def whole_ms(self, fraction: float) -> float:
        return (self.front_us + at(fraction, [sum(frame) for frame in self.frames])) / 1e3

    @property
    def most_p50_ms(self) -> float | None:
        """None: nothing is promised. A frame that follows a standing one waits for its scan."""
        is_met = (self.configuration, self.electrodes) in MEETS and self.load != "standing"
        return MOST_MS if is_met else None

    @property
    def most_p99_ms(self) -> float:
        return MOST_MS + 1e3 / RATE_HZ


class _Noted(StagedTime):
    """Adds up what plans have computed."""

    def __init__(self, slowness: float, stages_ns: Mapping[Stage, int]) -> None:
        super().__init__(slowness, stages_ns)
        self._told = Stages()
        self._costs_ns = stages_ns
        self.planned_ns = 0.0
        self.poll_ns = slowness * stages_ns["idle_poll"]

    def cost_ns(self, call: Call) -> int:
        for stage in self._told.behind(call):
            if stage == "plan_step":
                self.planned_ns += self.slowness * self._costs_ns[stage]
        return super().cost_ns(call)


class _Scene:
    """A display with the first so many electrodes of the array in use, fully open."""

    def __init__(self, electrodes: int, stages_ns: Mapping[Stage, int]) -> None:
        self._electrodes = electrodes
        self.processor = _Noted(PI4.slowness, stages_ns)
        self.rig: EngineRig = engine_rig.make(
            loaded=loaded_with(_REST_US), processor=self.processor, is_traced=False
        )
        self.rig.open()
        self.rig.arm()
        opened_to(self.rig, _CEILING_UA)
        self._seq = 1_000
        self.sent_ns: dict[int, int] = {}

    def send(self, pulses: int | None = None) -> int:
        """The next frame, with other currents than the one before; its seq."""
        self._seq += 1
        frame = Frame(
            lease=LEASE,
            seq=self._seq,
            current_ua=currents(self._electrodes, self._seq),
            width_us=WIDTH_US,
            rate_hz=RATE_HZ,
            pulses=pulses,
            ttl_ms=1_000,
        )
        assert self.rig.frames.send(NewFrame(ref=0, frame=frame))
        self.sent_ns[self._seq] = self.rig.clock.now_ns()
        return self._seq

    def parts_us(self, plan_us: float) -> list[tuple[float, ...]]:
        """Of all frames that were shown."""
        times_ns = {
            one.seq: (one.begun_ns, one.first_ns)
            for one in shown(self.rig)
            if one.first_ns is not None and one.seq in self.sent_ns
        }
        return [
            (
                (begun_ns - self.sent_ns[seq]) / 1e3 - plan_us,
                plan_us,
                (first_ns - begun_ns) / 1e3,
            )
            for seq, (begun_ns, first_ns) in times_ns.items()
        ]


def measure(configuration: str, electrodes: int, load: Load, frames: int) -> Latency:
    """Of so many frames that were shown."""
    scene = _Scene(electrodes, CONFIGURATIONS[configuration])
    plan_us = _plan_us(scene)
    scene.sent_ns.clear()
    if load == "flooded":
        _flood(scene, frames, PI4.slowness * max(CHARGED_US.values()))
    else:
        _one_by_one(scene, frames, stands=load == "standing")
    front_us = PI4.slowness * sum(CHARGED_US.values())
    shown_us = tuple(scene.parts_us(plan_us))
    found = Latency(configuration, electrodes, load, front_us, shown_us)
    assert scene.rig.state == "ARMED"
    assert scene.rig.close() == ()
    return found


def measure_all(frames: int) -> list[Latency]:
    return [
        measure(configuration, electrodes, load, frames)
        for configuration in CONFIGURATIONS
        for electrodes in ELECTRODES_IN_USE
        for load in LOADS
    ]


def front_table(measured: Sequence[Front]) -> Table:
    """For people."""
    table = Table(
        title="a frame before the engine: processor time, measured here (medians)",
        caption="charged: what the model of latency takes for it, before a machine's slowness",
    )
    for column in ("", *(f"{front.electrodes} electrodes" for front in measured), "charged"):
        table.add_column(column, justify="right" if column else "left")
    for part, charged_us in CHARGED_US.items():
        here = (f"{front.part_us(part, 0.5):.1f} us" for front in measured)
        table.add_row(part, *here, f"{charged_us:.1f} us")
    return table


def table(found: Sequence[Latency]) -> Table:
    """For people."""
    rows = Table(
        title=f"frame to first pulse on a modelled pi4 (computing {PI4.slowness:g} times as long)",
        caption=f"scans at {RATE_HZ:g} Hz; wait, plan and pulse are medians",
    )
    for column in ("engine", "electrodes", "display", *CHARGED_US, *STAGES, "p50", "p99"):
        rows.add_column(column, justify="right")
    for latency in found:
        front_us = [PI4.slowness * charged_us for charged_us in CHARGED_US.values()]
        stages_us = [latency.part_us(stage, 0.5) for stage in STAGES]
        rows.add_row(
            latency.configuration,
            str(latency.electrodes),
            latency.load,
            *(f"{us / 1e3:.2f}" for us in (*front_us, *stages_us)),
            *(f"{latency.whole_ms(fraction):.2f} ms" for fraction in (0.5, 0.99)),
        )
    return rows


def _plan_us(scene: _Scene) -> float:
    """What the poll and the plan of a frame compute, once the first have been planned."""
    for _ in range(_WARM_UP):
        before_ns = scene.processor.planned_ns
        scene.send(pulses=1)
        scene.rig.run_ms(_PAUSE_MS)
    return (scene.processor.planned_ns - before_ns + scene.processor.poll_ns) / 1e3


def _one_by_one(scene: _Scene, frames: int, *, stands: bool) -> None:
    """At any time of a tick; where frames stand, of a scan's period."""
    rng, spread_ms = random.Random(1), 1e3 / RATE_HZ if stands else 1.0
    for _ in range(frames):
        t_ns = scene.rig.clock.now_ns() + round(rng.uniform(0.0, spread_ms) * _MS)
        scene.rig.clock.at(t_ns, lambda: scene.send(pulses=None if stands else 1))
        scene.rig.run_ms(spread_ms + _PAUSE_MS)


def _flood(scene: _Scene, scans: int, every_us: float) -> None:
    """For so many scans."""
    end_ns = scene.rig.clock.now_ns() + round(scans / RATE_HZ * 1e9)

    def again() -> None:
        scene.send()
        if scene.rig.clock.now_ns() < end_ns:
            scene.rig.clock.at(scene.rig.clock.now_ns() + round(every_us * 1e3), again)

    again()
    scene.rig.run_ms(scans / RATE_HZ * 1e3 + _PAUSE_MS)
