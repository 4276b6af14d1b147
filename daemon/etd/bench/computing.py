"""The processor's time for a pulse: plain, with stabilizers, with a probe first; stage by stage.

Owns: how many pulses are measured, and which of them count. Must not know: ports, tables.

Calls take no time of the processor's here, and the engine's clock moves by calls and sleeps alone.
A pulse counts from one poll to the next. The first pulse of a scan is left out: its scan begins in
it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from etd.bench.stages import Stage, StageMeter, stages_of, summed
from etd.bench.subject import ELECTRODES, KINDS, Subject
from etd_hal.boardfile import MachineFile
from etd_hal.chips.codec import Codec
from etd_hal.ports import Clock
from etd_hal.unwired import MovedClock

#: Probes first need room as well.
_RATE_HZ = 20.0


class Computing(msgspec.Struct, frozen=True):
    """Of one kind of pulse: all of it, and its stages."""

    kind: str
    pulses: int
    whole: Stage
    stages: tuple[Stage, ...]


def visit_us(computing: Sequence[Computing]) -> float:
    """What a machine file says of a pulse: the median, plain or with stabilizers, whichever takes
    longer. A probe is counted as a pulse of its own.
    """
    return max(kind.whole.median_us for kind in computing if kind.kind != "with a probe first")


class _LookedAt:
    """The host's clock, which tells the meter that it is read."""

    def __init__(self, clock: MovedClock, look: Callable[[], None]) -> None:
        self._clock = clock
        self._look = look
        self.sleep_until_ns = clock.sleep_until_ns
        self.doze_until_ns = clock.doze_until_ns

    def now_ns(self) -> int:
        self._look()
        return self._clock.t_ns


def measure_computing(
    machine: MachineFile,
    codec: Codec,
    real: Clock,
    processor_ns: Callable[[], int],
    seconds: float,
) -> tuple[Computing, ...]:
    """Each kind of pulse for so many seconds, by a real clock; one scan at least.
    `processor_ns` is the time that the processor has spent on this thread.
    """
    return tuple(_of_kind(machine, codec, real, processor_ns, kind, seconds) for kind in KINDS)


def _of_kind(
    machine: MachineFile,
    codec: Codec,
    real: Clock,
    processor_ns: Callable[[], int],
    kind: str,
    seconds: float,
) -> Computing:
    clock, meter = MovedClock(), StageMeter(processor_ns)
    host_clock = _LookedAt(clock, meter.look)
    counted: list[list[int]] = []
    with Subject(machine, kind, codec, clock, meter.mark, host_clock) as subject:
        end_ns = real.now_ns() + int(seconds * 1e9)
        while not counted or real.now_ns() < end_ns:
            meter.pulses.clear()
            subject.play(_RATE_HZ)
            counted += meter.pulses[-ELECTRODES + 1 :]
    whole = summed("whole", [sum(pulse) for pulse in counted])
    return Computing(kind, len(counted), whole, stages_of(counted))
