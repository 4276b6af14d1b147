"""A scene played once, and from each of its operations on once more for every fault.

Owns: the processes that go on from an operation, each with a fault of its own, and how many there
are at a time. Must not know: which faults there are, tables.

A scene up to its n-th operation is the same in every case: it is played once, and what follows is
played by copies of the process that got there.
"""

from __future__ import annotations

import gc
import os
import resource
import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from campaign.account import Course
from campaign.case import Outcome, outcome
from campaign.kind import Kind
from campaign.operations import Interference, Killed, Operations, Port
from campaign.own_memory import all_shared, content, make_own
from campaign.places import Operation, operation
from campaign.scene import Over, Scene
from campaign.scenes import SCENES, config


class _Copies:
    """The processes that are under way, at most so many."""

    def __init__(self, most: int) -> None:
        self._pids: set[int] = set()
        self._most = most

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


@dataclass(frozen=True)
class Whole:
    """A scene on a board, played once without a fault."""

    board: str
    scene: str
    course: Course
    operations: Sequence[Operation]


def whole(board: str, scene: str) -> Whole:
    """What flows by when, and each operation. Raises: RuntimeError, where the scene itself is
    refused something or is not in order.
    """
    operations, course = Operations(), Course()
    found: list[Operation] = []
    played = SCENES[scene](config(board), operations, course)
    try:
        played.prepare()
        inside = played.play.__func__.__code__  # type: ignore[attr-defined]
        operations.before = lambda _, port: found.append(operation(port, inside))
        played.play()
        operations.before = lambda *_: None
        played.play_on(is_long=True)
    except Over:
        raise RuntimeError(f"{scene} halts on {board}: {played.problem()}") from None
    if problem := played.problem():
        raise RuntimeError(f"{scene} does not run on {board}: {problem}")
    played.close()
    return Whole(board, scene, course, found)


def places_of(board: str, scenes: Iterable[str]) -> set[tuple[Port, int]]:
    """All ports and places that these scenes have. Raises: as `whole`."""
    return {(one.port, one.place) for scene in scenes for one in whole(board, scene).operations}


def play(
    whole: Whole,
    wanted: Callable[[int, Port], Sequence[Kind]],
    results: Path,
    begun: Callable[[int], None] = lambda _: None,
    *,
    at_a_time: int = 1,
    version: str = "",
    played_at: str = "",
) -> None:
    """Appends an `Outcome` a line to `results` for each kind that is `wanted` of an operation, with
    the code's version and the time; `begun` is called with its number when all of its cases have
    begun.
    """
    operations, copies = Operations(), _Copies(at_a_time)
    copied: list[tuple[Kind, int, Port, int]] = []
    shared = all_shared()

    def before(number: int, port: Port) -> Interference | None:
        if copied:
            kind, first, *_ = copied[0]
            is_due = kind.then is not None and number == first + kind.then_after
            return kind.then.do(subject) if kind.then is not None and is_due else None
        kinds = wanted(number, port)
        if kinds:
            # What has been made since is not frozen yet, and so is among what is looked at.
            memories = [*shared, *all_shared()]
            before_copying = [content(memory) for memory in memories]
        for kind in kinds:
            if copies.is_copy():
                for memory, bytes_before in zip(memories, before_copying, strict=True):
                    make_own(memory, bytes_before)
                now_ns = subject.clock.now_ns()
                subject.body.mark(now_ns)
                copied.append((kind, number, port, now_ns))
                return kind.do(subject)
        begun(number)
        return None

    played = SCENES[whole.scene](config(whole.board), operations, None)
    subject = played.subject
    played.prepare()
    operations.count = 0
    shared += all_shared()
    gc.collect()
    gc.freeze()
    operations.before = before
    try:
        end = _play_to_the_end(played, copied)
        if copied:
            kind, number, port, begun_ns = copied[0]
            said = played.said(begun_ns)
            said = said if end is None else replace(said, seen=end)
            subject.fake.settle()
            found = outcome(
                *(whole.board, whole.scene, kind, number, port),
                *(said, subject.body, begun_ns, subject.clock.now_ns(), whole.course),
                played.pulse_pc,
                leaves_supply_on=_can_be_off(whole.board) and played.leaves_supply_on,
            )
            _append(
                results,
                msgspec.structs.replace(
                    found, version=version, played=played_at, processor_s=_processor_s()
                ),
            )
            os._exit(0)
    except BaseException:
        if copied:
            traceback.print_exc()
            os._exit(1)
        raise
    operations.before = lambda *_: None
    copies.end()
    played.close()
    gc.unfreeze()


def _play_to_the_end(played: Scene, copied: Sequence[tuple[Kind, int, Port, int]]) -> str | None:
    """How it ended, where it did not by itself."""
    try:
        try:
            played.play()
            if copied:
                played.play_on(copied[0][0].needs_time)
        except Over:
            played.insist()
    except Killed:
        played.after_kill()
        return "ended"
    except Exception as error:
        # A program must not end by an error of its own, whatever fails: the table says so.
        if not copied:
            raise
        return f"crashed: {error!r}"
    return None


def _can_be_off(board: str) -> bool:
    return config(board).board.guards.hv_enable != "absent"


def _processor_s() -> float:
    """Of this process, since it was forked."""
    taken = resource.getrusage(resource.RUSAGE_SELF)
    return taken.ru_utime + taken.ru_stime


def _append(results: Path, found: Outcome) -> None:
    """One write, which no other process's falls into."""
    with results.open("ab", buffering=0) as file:
        file.write(msgspec.json.encode(found) + b"\n")
