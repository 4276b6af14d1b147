"""The processes beside a scan, for real: the stopper on lines that take no call, and its end."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from etd_hal.cutlatch import CUTS, DUE_NS, LOOKED_NS, SEEN, CutLatch
from etd_hal.errors import BusError
from etd_hal.linux.beside import stopper_process
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.side_process import SideProcess
from etd_hal.supply_note import SupplyNote
from intruder import rightless, tried

CLOCK = LinuxClock()
MS = 1_000_000
PATIENCE_NS = 60_000 * MS
#: The rig of kernels shows 20 ms; here other tests have the processors: the best of a few counts.
OVER_WITHIN_MS = 1_000.0
TRIES = 3
#: A driving process: it starts a stopper, says its number, and does nothing more.
_DRIVING = """
import os, signal, sys
sys.path[:] = {path!r}
from test_side_process import stopper_of
from etd_hal.cutlatch import POWER, CutLatch
latch = CutLatch()
process = stopper_of(latch, note={note!r})
assert not process.refusals
latch.words[POWER] = {power}
process.watch({is_needed})
if {has_child}:
    child = os.fork()
    if not child:
        while True:
            signal.pause()
    print(child, flush=True)
print(process.pid, flush=True)
sys.stdin.read()
"""


def stopper_of(
    latch: CutLatch, scan_core: int | None = None, note: str | None = None
) -> SideProcess:
    """Its lines are the latch's memory: a file that knows no call for lines."""
    lines = os.dup(latch.memory.fd)
    try:
        return stopper_process(latch, lines, bytes(16), note, None, scan_core)
    finally:
        os.close(lines)


@contextmanager
def stopper(latch: CutLatch) -> Iterator[SideProcess]:
    made = stopper_of(latch)
    try:
        assert made.refusals == ()
        yield made
    finally:
        made.end()


def wait_until(is_so: Callable[[], bool]) -> None:
    until_ns = CLOCK.now_ns() + PATIENCE_NS
    while not is_so():
        assert CLOCK.now_ns() < until_ns
        CLOCK.doze_until_ns(CLOCK.now_ns() + MS)


def is_over(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_it_checks_while_it_is_needed_and_rests_otherwise() -> None:
    latch = CutLatch()
    with stopper(latch) as made:
        CLOCK.doze_until_ns(CLOCK.now_ns() + 20 * MS)
        assert latch.words[LOOKED_NS] == 0
        begun_ns = CLOCK.now_ns()
        made.watch(True)
        wait_until(lambda: latch.words[LOOKED_NS] > begun_ns + 5 * MS)
        made.watch(False)
        CLOCK.doze_until_ns(CLOCK.now_ns() + 50 * MS)
        rested_ns = latch.words[LOOKED_NS]
        CLOCK.doze_until_ns(CLOCK.now_ns() + 20 * MS)
        assert latch.words[LOOKED_NS] == rested_ns
    assert is_over(made.pid)


def test_it_counts_a_cut_of_an_overdue_message_and_survives_lines_that_fail() -> None:
    latch = CutLatch()
    with stopper(latch) as made:
        made.watch(True)
        latch.words[DUE_NS] = CLOCK.now_ns() + 50 * MS
        wait_until(lambda: latch.is_cut)
        assert latch.words[LOOKED_NS] > latch.words[DUE_NS] - 50 * MS
        assert latch.words[CUTS] == 1
        looked_ns = latch.words[LOOKED_NS]
        wait_until(lambda: latch.words[LOOKED_NS] > looked_ns + 5 * MS)
        assert latch.words[CUTS] == 1
        assert latch.see() == latch.words[SEEN] == 1


def test_what_ends_a_whole_service_does_not_end_it() -> None:
    with stopper(CutLatch()) as made:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGABRT):
            os.kill(made.pid, number)
        CLOCK.doze_until_ns(CLOCK.now_ns() + 50 * MS)
        assert not is_over(made.pid)


def test_nobody_of_its_user_takes_the_lines_from_it_or_writes_its_memory() -> None:
    program = _DRIVING.format(
        path=[str(Path(__file__).parent), *sys.path],
        has_child=False,
        is_needed=True,
        power=1,
        note=None,
    )
    with subprocess.Popen(
        rightless(sys.executable, "-c", program), stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        found = tried(int(process.stdout.readline()))
    assert len(found) == 7
    assert set(found.values()) <= {"EPERM", "EACCES"}


@contextmanager
def driving(
    *, has_child: bool = False, is_needed: bool = True, power: int = 1, note: str | None = None
) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """A driving process, and the pidfd of its stopper. `has_child`: a fork of it has inherited all
    that it holds, and outlives it.
    """
    program = _DRIVING.format(
        path=[str(Path(__file__).parent), *sys.path],
        has_child=has_child,
        is_needed=is_needed,
        power=power,
        note=note,
    )
    child = None
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        if has_child:
            child = int(process.stdout.readline())
        over = os.pidfd_open(int(process.stdout.readline()))
        try:
            yield process, over
        finally:
            process.kill()
            os.close(over)
            if child is not None:
                os.kill(child, signal.SIGKILL)


def is_over_within(over: int, within_s: float) -> bool:
    return bool(select.select([over], (), (), within_s)[0])


def test_it_is_over_soon_after_the_driving_process_was_killed() -> None:
    took_ms = []
    for _ in range(TRIES):
        with driving() as (process, over):
            killed_ns = CLOCK.now_ns()
            process.kill()
            assert is_over_within(over, PATIENCE_NS / 1e9)
            took_ms.append((CLOCK.now_ns() - killed_ns) / MS)
    assert min(took_ms) < OVER_WITHIN_MS


@pytest.mark.parametrize("is_needed", [True, False])
def test_a_child_that_holds_the_socket_open_keeps_it_from_nothing(is_needed: bool) -> None:
    """While it checks the mark tells it, and the pidfd where it waits."""
    with driving(has_child=True, is_needed=is_needed) as (process, over):
        CLOCK.doze_until_ns(CLOCK.now_ns() + 20 * MS)
        assert not is_over_within(over, 0.0)
        process.kill()
        assert is_over_within(over, PATIENCE_NS / 1e9)


def test_the_note_stays_after_a_kill_with_the_supply_on(tmp_path: Path) -> None:
    note = SupplyNote(tmp_path / "supply.json")
    with driving(note=str(note.path)) as (process, over):
        wait_until(note.path.exists)
        process.kill()
        assert is_over_within(over, PATIENCE_NS / 1e9)
    assert note.left() is not None


def test_the_last_word_of_a_process_counts_also_where_it_was_not_woken_for_it(
    tmp_path: Path,
) -> None:
    """It ended right after it had made the board safe."""
    note = SupplyNote(tmp_path / "supply.json")
    note.keep()
    with driving(is_needed=False, power=2, note=str(note.path)) as (process, over):
        process.kill()
        assert is_over_within(over, PATIENCE_NS / 1e9)
    assert note.left() is None


def test_a_core_that_it_cannot_leave_is_told() -> None:
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        made = stopper_of(CutLatch(), min(cores))
        (told,) = made.refusals
    finally:
        os.sched_setaffinity(0, cores)
    made.end()
    assert told.startswith(f"the stopper: a core other than the scan's ({min(cores)}) was not")


def test_one_that_does_not_come_up_is_an_error() -> None:
    with pytest.raises(BusError, match="beginning on the absent") as raised:
        _ = SideProcess("the absent", "no_such_module", ()).refusals
    assert raised.value.kind == "gone"
