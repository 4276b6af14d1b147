"""What the board's calls take on this machine: messages at DAC code 0, and a call of lines.

Owns: which calls are timed. Must not know: tables, files. The supply stays off, and nothing is
connected.
"""

from __future__ import annotations

import statistics

import msgspec

from etd.protocol.errors import BoardFault
from etd_hal.board import Board
from etd_hal.ports import Clock
from etd_hal.timing import check

_CALLS = 200


class Messages(msgspec.Struct, frozen=True):
    """In us; `problem` is the first constant that the machine file does not allow, if any."""

    word_us: float
    delay_extra_us: float
    message_us: float
    spread_us: float
    gpio_call_us: float
    problem: str | None


def measure_messages(board: Board, clock: Clock) -> Messages:
    """A board in its safe state. Raises: BusError, GuardRefusal."""
    found, problem = board.time_messages(), None
    try:
        check(found, board.machine)
    except BoardFault as fault:
        problem = str(fault)
    return Messages(
        found.word_us,
        found.delay_extra_us,
        found.message_us,
        found.spread_us,
        statistics.median(_call_us(board, clock) for _ in range(_CALLS)),
        problem,
    )


def _call_us(board: Board, clock: Clock) -> float:
    """Of a call that sets the lines of the switch to the level that they have: harmless."""
    begun_ns = clock.now_ns()
    board.blank_now()
    return (clock.now_ns() - begun_ns) / 1_000
