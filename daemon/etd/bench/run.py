"""The bench in its order: the processor, the wake-ups, the loop, the board's calls.

Owns: the order, and for how long each part is measured. Must not know: which backend there is,
tables, files.

The processor is measured first, by an ordinary thread: the kernel throttles a real-time one that
never sleeps. Everything after is measured as the engine runs.
"""

from __future__ import annotations

import datetime
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass

from etd.bench.computing import measure_computing
from etd.bench.loop import measure_loop
from etd.bench.messages import Messages, measure_messages
from etd.bench.result import Result
from etd.bench.subject import KINDS
from etd.bench.wakeups import measure_wakeups
from etd.planning.duty import busy_fraction, told_of
from etd.protocol.errors import BoardFault, BusError, HardwareMissing
from etd.version import __version__
from etd_hal.bench import ScanCore
from etd_hal.board import Board
from etd_hal.boardfile import MachineFile
from etd_hal.chips.codec import Codec
from etd_hal.compiled import runs
from etd_hal.wakeups import NotingClock

FORMAT = 1
#: Of the whole time, that of each part.
_COMPUTING, _WAKEUPS, _LOOP = 0.5, 0.2, 0.3


@dataclass(frozen=True, slots=True)
class Parts:
    """What a command hands in. `timed_board` opens a board in its safe state, hands it on, and
    closes it again; it raises HardwareMissing, BusError or BoardFault where there is none.
    """

    machine: MachineFile
    codec: Codec
    clock: NotingClock
    processor_ns: Callable[[], int]
    now: datetime.datetime
    facts: tuple[str, ...]
    set_up_realtime: Callable[[], tuple[str, ...]]
    #: What the kernel does with a real-time thread on the calling thread's core.
    scan_core: Callable[[], ScanCore]
    timed_board: Callable[[Callable[[Board], Messages]], Messages]


def measure(parts: Parts, seconds: float, tell: Callable[[str], object]) -> Result:
    """Every part in turn; `tell` is called with a sentence before each."""
    machine, codec, clock = parts.machine, parts.codec, parts.clock
    each_s = _COMPUTING * seconds / len(KINDS)
    tell(f"the processor, {each_s:.0f} s for each of {', '.join(KINDS)}")
    computing = measure_computing(machine, codec, clock, parts.processor_ns, each_s)
    cores = sorted(os.sched_getaffinity(0))
    not_granted = parts.set_up_realtime()
    core = parts.scan_core()
    tell(f"wake-ups, {_WAKEUPS * seconds:.0f} s, half of them beside busy loops")
    wakeups = measure_wakeups(clock, _WAKEUPS * seconds, cores)
    tell(f"the loop on the real clock, {_LOOP * seconds:.0f} s")
    loop = measure_loop(machine, codec, clock, _LOOP * seconds)
    tell("the board's calls, with the supply off and the DAC at zero")
    messages, no_board = _messages(parts)
    return Result(
        version=FORMAT,
        date=parts.now.isoformat(),
        etd=__version__,
        python=platform.python_version(),
        code=runs(),
        machine=machine.name,
        facts=(*parts.facts, told_of(busy_fraction(core.is_left_alone), str(core))),
        not_granted=not_granted,
        computing=computing,
        wakeups=wakeups,
        loop=loop,
        messages=messages,
        no_board=no_board,
    )


def _messages(parts: Parts) -> tuple[Messages | None, str | None]:
    try:
        return parts.timed_board(lambda board: measure_messages(board, parts.clock)), None
    except (HardwareMissing, BusError, BoardFault) as error:
        return None, str(error)
