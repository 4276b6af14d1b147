"""The result of a bench: the file that a person can send, and the table that a person reads.

Owns: both formats, and what of the machine file each figure is compared with. Must not know: how
anything is measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import msgspec

from etd.bench.computing import Computing, visit_us
from etd.bench.loop import LoopFigures
from etd.bench.messages import Messages
from etd.bench.stages import Stage
from etd.bench.wakeups import Wakeups
from etd_hal.boardfile import Bounds, MachineFile


class Result(msgspec.Struct, frozen=True):
    """All figures are in us unless their name says otherwise."""

    version: int
    #: ISO 8601, UTC.
    date: str
    etd: str
    python: str
    #: The engine's code: it takes a third of the time when it is compiled.
    code: Literal["compiled", "interpreted"]
    #: The name of the machine file, and what the kernel says of the machine.
    machine: str
    facts: tuple[str, ...]
    #: What of the real-time settings was not granted: the loop is later then.
    not_granted: tuple[str, ...]
    computing: tuple[Computing, ...]
    wakeups: Wakeups
    #: A sentence where the engine did not stay armed for a single scan.
    loop: LoopFigures | str
    #: None without a board: `no_board` is the reason then.
    messages: Messages | None
    no_board: str | None


def lines_of(result: Result, machine: MachineFile) -> Iterator[str]:
    """The table, beside the figures of the machine file."""
    yield (
        f"etd {result.etd}, {result.code}, Python {result.python}, machine file {result.machine}"
    )
    yield from (f"  {fact}" for fact in result.facts)
    yield from (f"  not granted: {sentence}" for sentence in result.not_granted)
    yield ""
    yield from _computing(result.computing, machine)
    yield ""
    yield f"{'late, in us':<34}{'median':>9}{'p99':>9}{'worst':>9}"
    wakeups = result.wakeups
    yield _row("wake-ups, idle", wakeups.idle)
    yield _row("wake-ups beside busy loops", wakeups.busy) + f"{wakeups.worst_us:>9.0f}"
    yield (
        f"spun at the end of each sleep: {wakeups.spun_us:.0f} us; {wakeups.beyond} wake-ups came"
        " later than that"
    )
    yield from _loop(result.loop)
    yield ""
    yield from _messages(result, machine)


def _computing(computing: tuple[Computing, ...], machine: MachineFile) -> Iterator[str]:
    yield f"{'processor time of a pulse, in us':<34}{'median':>9}{'p99':>9}"
    for kind in computing:
        yield _row(kind.kind, kind.whole)
        yield from (_row(f"  {stage.name}", stage) for stage in kind.stages)
    found_us = visit_us(computing)
    yield (
        f"visit_us of the machine file: {machine.visit_us:.0f} us, pulses with stabilizers here"
        f" {found_us / machine.visit_us:.2f} times that"
    )


def _loop(loop: LoopFigures | str) -> Iterator[str]:
    if isinstance(loop, str):
        yield f"the loop did not stay armed for a scan: {loop}"
        return
    yield _row("messages of the loop", loop.late) + f"{loop.worst_us:>9.0f}"
    yield (
        f"a scan of 64 electrodes: {loop.scan_ms:.1f} ms, of which widths and rests are"
        f" {loop.least_ms:.1f} ms ({loop.scan_ms / loop.least_ms:.2f} times)"
    )
    if loop.ended_by is not None:
        yield f"the loop did not stay armed: {loop.ended_by}"


def _row(name: str, stage: Stage) -> str:
    return f"{name:<34}{stage.median_us:>9.1f}{stage.p99_us:>9.1f}"


def _messages(result: Result, machine: MachineFile) -> Iterator[str]:
    found = result.messages
    if found is None:
        yield f"messages and lines were not timed: {result.no_board}"
        return
    yield f"{'calls of the board, in us':<34}{'found':>9}   machine file"
    yield _bounded("one word", found.word_us, machine.word_us)
    yield _bounded("overhead of a delay", found.delay_extra_us, machine.delay_extra_us)
    yield _bounded("overhead of a message", found.message_us, machine.message_us)
    yield f"{'spread of a message':<34}{found.spread_us:>9.2f}   at most {machine.spread_us}"
    yield f"{'a call of lines':<34}{found.gpio_call_us:>9.2f}   {machine.gpio_call_us}"
    if found.problem is not None:
        yield f"the engine would not start: {found.problem}"


def _bounded(name: str, found_us: float, bounds: Bounds) -> str:
    return f"{name:<34}{found_us:>9.2f}   {bounds.low} to {bounds.high}"
