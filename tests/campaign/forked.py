"""A scene played once, and from each of its operations on once more for every fault.

Owns: the processes that go on from an operation, each with a fault of its own, and how many there
are at a time. Must not know: which faults there are, tables.

A scene up to its n-th operation is the same in every case: it is played once, and what follows is
played by copies of the process that got there.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from campaign import scenes
from campaign.account import Account
from campaign.case import Outcome, outcome
from campaign.kinds import Kind
from campaign.operations import Interference, Killed, Operations, Port
from campaign.own_memory import all_shared, content, make_own

#: At a time, for each core.
_COPIES_A_CORE = 1


class _Copies:
    """The processes that are under way."""

    def __init__(self) -> None:
        self._pids: set[int] = set()
        self._most = _COPIES_A_CORE * (os.cpu_count() or 1)

    def is_copy(self) -> bool:
        """Fork; True in the copy. Waits while there are as many as may be."""
        while len(self._pids) >= self._most:
            self._wait()
        pid = os.fork()
        if pid:
            self._pids.add(pid)
        return not pid

    def end(self) -> None:
        while self._pids:
            self._wait()

    def _wait(self) -> None:
        pid, status = os.wait()
        self._pids.discard(pid)
        if status:
            raise RuntimeError(f"a case ended with status {status}")


def whole(board: str) -> tuple[Account, list[Port]]:
    """What flows without a fault, and the port of each operation. Raises: RuntimeError, where the
    script itself is refused something.
    """
    operations = Operations()
    ports: list[Port] = []
    rig, body = scenes.rig_of(board, operations)
    operations.before = lambda _, port: ports.append(port)
    scenes.play(rig)
    operations.before = lambda *_: None
    found = body.account(rig.clock.now_ns())
    refused = [answer.reason for answer in rig.answers.values() if answer.error is not None]
    if refused:
        raise RuntimeError(f"the script does not run on {board}: {refused[0]}")
    rig.close()
    return found, ports


def play(
    board: str,
    allowed: Account,
    wanted: Callable[[int, Port], Sequence[Kind]],
    results: Path,
    begun: Callable[[int], None] = lambda _: None,
) -> None:
    """Appends an `Outcome` a line to `results` for each kind that is `wanted` of an operation;
    `begun` is called with its number when all of its cases have begun.
    """
    operations, copies = Operations(), _Copies()
    copied: list[tuple[Kind, int, Port, int]] = []

    def before(number: int, port: Port) -> Interference | None:
        if copied:
            kind, first, *_ = copied[0]
            is_due = kind.then is not None and number == first + kind.then_after
            return kind.then.do(rig) if kind.then is not None and is_due else None
        before_copying = [content(memory) for memory in shared]
        for kind in wanted(number, port):
            if copies.is_copy():
                for memory, bytes_before in zip(shared, before_copying, strict=True):
                    make_own(memory, bytes_before)
                copied.append((kind, number, port, rig.clock.now_ns()))
                return kind.do(rig)
        begun(number)
        return None

    rig, body = scenes.rig_of(board, operations)
    operations.count = 0
    shared = all_shared()
    gc.collect()
    gc.freeze()
    operations.before = before
    end = None
    try:
        scenes.play(rig)
    except Killed:
        end = "ended"
    except Exception as error:
        # An engine must not end by an error, whatever fails: the table says so.
        if not copied:
            raise
        end = f"crashed: {error!r}"
    if copied:
        kind, number, port, begun_ns = copied[0]
        found = outcome(
            *(board, kind.name, kind.fault_class, number, port),
            *(rig, body, begun_ns, allowed, end),
        )
        _append(results, found)
        os._exit(0)
    operations.before = lambda *_: None
    copies.end()
    rig.close()


def _append(results: Path, found: Outcome) -> None:
    """One write, which no other process's falls into."""
    with results.open("ab", buffering=0) as file:
        file.write(msgspec.json.encode(found) + b"\n")
