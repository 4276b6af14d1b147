"""The line of newcomers, which the kernel has once for all users: it is emptied faster than filled.

Owns: how soon a newcomer is heard behind a full line, and who is closed at once for that.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import pytest

from etd.protocol.link import StopNow
from gateway_rig import GatewayRig
from raw_client import (
    connected,
    connected_by_another,
    connected_by_others,
    hello,
    is_closed,
    part,
    poured,
)

STOP = hello("DEALER") + part(b'{"op":"stop"}')
#: A stop behind a line of 128: three looks at it, and one in which it is read.
LOOKS = 4
#: Of one process, that have said nothing: closed in their first look.
SILENT_A_LOOK = 8


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as made:
        yield made


@pytest.fixture
def held() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def fill(rig: GatewayRig, held: ExitStack | None) -> int:
    """The line, to its end, with newcomers that say nothing; how many that were. `held`: they stay;
    None: each is closed at once.
    """
    count = 0
    with suppress(BlockingIOError):
        while True:
            made = connected(rig.folder / "control.sock")
            if held is None:
                made.close()
            else:
                held.enter_context(made)
            count += 1
    return count


def stops_heard(rig: GatewayRig) -> int:
    return sum(isinstance(said, StopNow) for said in rig.engine.heard)


@pytest.mark.parametrize("they_stay", [False, True], ids=["left", "silent"])
def test_a_stop_that_is_last_in_a_full_line_is_heard_soon(
    rig: GatewayRig, held: ExitStack, they_stay: bool
) -> None:
    staying = held if they_stay else None
    assert fill(rig, staying) > 100
    rig.step()
    assert fill(rig, staying) > 40, "the kernel's line is emptied in part"
    rig.step()
    stopper = held.enter_context(connected(rig.folder / "control.sock"))
    poured(stopper, STOP)
    for _ in range(LOOKS):
        fill(rig, staying)
        rig.step()
    assert stops_heard(rig) == 1


def test_who_has_left_is_no_newcomer_and_a_stop_that_it_left_behind_is_heard(
    rig: GatewayRig,
) -> None:
    before = rig.counter("control_disconnects")
    for said in (b"", STOP, b""):
        with connected(rig.folder / "control.sock") as made:
            poured(made, said)
    rig.step(2)
    assert stops_heard(rig) == 1
    assert rig.counter("control_disconnects") == before + 3
    assert not rig.counter("control_turned_away")


def test_of_a_process_only_so_many_are_let_in_at_once_before_they_say_something(
    rig: GatewayRig, held: ExitStack
) -> None:
    path = rig.folder / "control.sock"
    silent = [held.enter_context(connected(path)) for _ in range(SILENT_A_LOOK + 3)]
    others = [held.enter_context(connected_by_another(path)) for _ in range(2)]
    said = held.enter_context(connected(path))
    poured(said, STOP)
    rig.step(2)
    assert [is_closed(one) for one in silent] == [False] * SILENT_A_LOOK + [True] * 3
    assert not any(is_closed(one) for one in (*others, said))
    assert rig.counter("control_turned_away") == 3
    assert stops_heard(rig) == 1


def test_a_crowd_of_processes_is_let_in_a_few_a_look(rig: GatewayRig, held: ExitStack) -> None:
    """So that each has some looks to say something before others take its place."""
    crowd = [
        held.enter_context(made) for made in connected_by_others(rig.folder / "control.sock", 20)
    ]
    rig.step()
    assert [is_greeted(made) for made in crowd] == [True] * 16 + [False] * 4
    rig.step()
    assert is_greeted(crowd[-1])


def is_greeted(made: socket.socket) -> bool:
    try:
        return bool(made.recv(65_536))
    except BlockingIOError:
        return False
