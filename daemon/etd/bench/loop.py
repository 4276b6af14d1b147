"""The loop as it will run: on the real clock, with calls that take the time of real ones.

Owns: the lateness of each message, and the rate that the scans reach. Must not know: ports, tables,
how the process became real-time.

A message is late by what lies between the end of the rest before it and its beginning, less the
call that connects. The machine file says how long calls and messages take; the processor is as busy
with them as the kernel's drivers make it.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable

import msgspec

from etd.bench.stages import Stage, summed
from etd.bench.subject import ELECTRODES, REST_US, WIDTH_US, Subject
from etd.protocol.errors import BoardFault
from etd_hal.boardfile import MachineFile
from etd_hal.chips.codec import Codec
from etd_hal.unwired import BusyClock, Mark
from etd_hal.wakeups import NotingClock

#: More than any machine reaches: the loop goes as fast as it can.
_RATE_HZ = 45.0


class LoopFigures(msgspec.Struct, frozen=True):
    """`scan_ms` is the median from the first message of a scan to its last, and `least_ms` the sum
    of its widths and rests. `ended_by`: why the engine did not stay armed, if it did not.
    """

    late: Stage
    worst_us: float
    scan_ms: float
    least_ms: float
    ended_by: str | None


class _Lateness:
    """What the ports mark: a rest is waited for, then lines are set, then a message begins."""

    def __init__(self, now_ns: Callable[[], int], call_ns: int) -> None:
        self._now_ns = now_ns
        self._call_ns = call_ns
        self._rest_ns = 0
        #: Of the scan under way: when each message began, and by how much it was late.
        self._scan: list[tuple[int, int]] = []
        self.late_ns: list[int] = []
        self.scans_ns: list[int] = []

    def mark(self, mark: Mark, value: int) -> None:
        if mark == "rest":
            self._rest_ns = value
        elif mark == "message" and value:
            now_ns = self._now_ns()
            self._scan.append((now_ns, now_ns - self._rest_ns - self._call_ns))

    def forget(self) -> None:
        """What came before the first scan that counts."""
        self._scan.clear()

    def end_scan(self) -> None:
        """The check of the source may go before a scan, and its first pulse waits for no rest."""
        first, *others = self._scan[-ELECTRODES:]
        self.late_ns += [late_ns for _, late_ns in others]
        self.scans_ns.append(others[-1][0] - first[0])
        self._scan.clear()


def measure_loop(
    machine: MachineFile, codec: Codec, real: NotingClock, seconds: float
) -> LoopFigures | str:
    """Plain pulses for so many seconds. The calling thread is as real-time as it will be. Returns
    a sentence where the engine did not stay armed for a single scan.
    """
    lateness = _Lateness(real.now_ns, int(machine.gpio_call_us * 1_000))
    ended_by = None
    try:
        busy = BusyClock(real)
        with Subject(machine, "plain", codec, busy, lateness.mark, real, real.wakeups) as subject:
            lateness.forget()
            end_ns = real.now_ns() + int(seconds * 1e9)
            while not lateness.scans_ns or real.now_ns() < end_ns:
                subject.play(_RATE_HZ)
                lateness.end_scan()
    except BoardFault as fault:
        ended_by = fault.measured
    if ended_by is not None and not lateness.scans_ns:
        return ended_by
    late_ns = lateness.late_ns
    least_ms = (ELECTRODES - 1) * (WIDTH_US + REST_US) / 1_000
    return LoopFigures(
        summed("late", late_ns),
        max(late_ns) / 1_000,
        statistics.median(lateness.scans_ns) / 1e6,
        least_ms,
        ended_by,
    )
