"""Connections to the gateway: who is let in, who gives way, and what ends one.

Owns: the bounds on connections, their handshake and what they leave unread, and their counts.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
import zmq

from etd.gateway.places import MOST_CONNECTIONS, MOST_GUESTS
from etd.gateway.request_queue import RequestQueue
from etd.gateway.sockets import Sockets
from etd.protocol.link import StopNow
from etd.protocol.messages import TOPICS
from gateway_rig import GatewayRig, no_descriptor_left
from raw_client import (
    connected,
    connected_by_another,
    connected_by_others,
    hello,
    is_closed,
    part,
    poured,
)

GOOD = hello("DEALER")


#: As each client does: it looks whether anybody listens, and then connects. Here both wait to be
#: accepted at once.
LOOK_AND_STOP = """
import socket, sys
for said in (b"", bytes.fromhex(sys.argv[2])):
    made = socket.socket(socket.AF_UNIX)
    made.connect(sys.argv[1])
    made.send(said)
"""


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as rig:
        yield rig


def client(rig: GatewayRig, stack: ExitStack, first: bytes, name: str = "control") -> socket.socket:
    made = stack.enter_context(connected(rig.folder / f"{name}.sock"))
    poured(made, first)
    return made


def is_ended(rig: GatewayRig, held: socket.socket) -> bool:
    """By the gateway, in a step."""
    rig.step()
    return is_closed(held)


@pytest.mark.parametrize(
    "first",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"\xff" + bytes(8) + b"\x7f\x01" + bytes(53),
        GOOD[:12] + b"CURVE".ljust(20, b"\0") + GOOD[32:],
        hello("SUB"),
        GOOD[:64] + part(b'{"op":"hello"}'),
        GOOD + b"\x08\x00",
        GOOD + b"\x04\x04\x03FOO",
        GOOD + b"\x02" + (1 << 60).to_bytes(8, "big"),
        GOOD + part(b"", more=True) * 20,
        GOOD + part(b"x" * 40_000, more=True) * 2,
    ],
    ids=[
        "http",
        "an old version",
        "another mechanism",
        "another type of socket",
        "no READY",
        "a flag that is none",
        "a command that is none",
        "a length without an end",
        "many parts",
        "long parts",
    ],
)
def test_a_client_that_breaks_the_protocol_is_closed_and_counted(
    rig: GatewayRig, first: bytes
) -> None:
    with ExitStack() as stack:
        made = client(rig, stack, first)
        rig.until(lambda: is_ended(rig, made))
    rig.until(lambda: rig.counter("control_broken_off") == 1)
    assert rig.call(op="hello")["ok"]


def test_a_handshake_byte_by_byte_is_understood(rig: GatewayRig) -> None:
    said = GOOD + part(b"", more=True) + part(b'{"op":"hello","id":7}')
    with ExitStack() as stack:
        made = client(rig, stack, b"")
        for place in range(len(said)):
            poured(made, said[place : place + 1])
            rig.step()
        reply = made.recv(65_536)
    assert b'"id":7' in reply


def test_a_ping_is_answered_with_what_it_says(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        made = client(rig, stack, GOOD + b"\x04\x09\x04PING\x00\x0aab")
        rig.step(2)
        assert made.recv(65_536).endswith(b"\x04\x07\x04PONGab")


def test_a_stop_of_a_client_that_is_gone_when_it_is_read_stops(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        client(rig, stack, GOOD + part(b'{"op":"status"}') + part(b'{"op":"stop"}'))
    rig.until(lambda: any(isinstance(said, StopNow) for said in rig.engine.heard))


def test_the_silent_give_way_to_newcomers_and_clients_do_not(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        silent = []
        for _ in range(2 * MOST_CONNECTIONS):
            silent.append(client(rig, stack, b""))
            rig.step()
        assert rig.call(op="hello")["ok"], "who was there first is still there"
        newcomer = stack.enter_context(rig.socket(zmq.DEALER, "control.sock"))
        newcomer.send(b'{"op":"hello"}')
        assert rig.reply(newcomer)["ok"]
        assert is_ended(rig, silent[0])
        assert not is_ended(rig, silent[-1])
    assert rig.counter("control_turned_away") >= MOST_CONNECTIONS


def test_a_full_socket_has_no_room_for_more_of_the_same_process(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        held = []
        for _ in range(MOST_CONNECTIONS + 10):
            held.append(client(rig, stack, GOOD))
            rig.step()
        assert rig.counter("control_turned_away") == 11, "the rig's own is one more"
        assert not is_ended(rig, held[0])
        assert is_ended(rig, held[-1])
    rig.until(lambda: rig.counter("control_disconnects") == MOST_CONNECTIONS - 1)


def test_a_request_of_a_client_that_was_turned_away_is_sent_again_when_there_is_room(
    rig: GatewayRig,
) -> None:
    with ExitStack() as stack:
        held = []
        for _ in range(MOST_CONNECTIONS - 1):
            held.append(client(rig, stack, GOOD))
            rig.step()
        late = stack.enter_context(rig.socket(zmq.DEALER, "control.sock"))
        late.send(b'{"op":"hello"}')
        rig.until(lambda: rig.counter("control_turned_away") == 1)
        held[0].close()
        assert rig.reply(late)["ok"]


def test_the_process_with_most_connections_ends_no_handshake_of_another(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        for _ in range(MOST_CONNECTIONS):
            client(rig, stack, GOOD)
            rig.step()
        # A newcomer of another process, that has not said anything yet.
        newcomer = stack.enter_context(connected_by_another(rig.folder / "control.sock"))
        rig.step()
        for _ in range(5):
            client(rig, stack, GOOD)
            rig.step()
        assert not is_ended(rig, newcomer)
        poured(newcomer, GOOD + part(b'{"op":"hello","id":7}'))
        rig.step(2)
        assert b'"id":7' in newcomer.recv(65_536)


def test_a_connection_with_unread_bytes_does_not_give_way(rig: GatewayRig) -> None:
    """A stop that came with the handshake would be lost: no client sends it again."""
    with ExitStack() as stack:
        for _ in range(MOST_CONNECTIONS - 2):
            client(rig, stack, GOOD)
            rig.step()
        stopper = stack.enter_context(connected_by_another(rig.folder / "control.sock"))
        rig.step()
        poured(stopper, GOOD + part(b'{"op":"stop","client":"t"}'))
        stack.enter_context(connected_by_another(rig.folder / "control.sock"))
        rig.step(2)
        assert any(isinstance(said, StopNow) for said in rig.engine.heard)


def crowded(
    rig: GatewayRig, stack: ExitStack, count: int, first: bytes = GOOD
) -> list[socket.socket]:
    """So many connections of this user, each of a process of its own, that say this first."""
    made = []
    for one in connected_by_others(rig.folder / "control.sock", count):
        made.append(stack.enter_context(one))
        poured(one, first)
        rig.step()
    return made


def stops_heard(rig: GatewayRig) -> int:
    return sum(isinstance(said, StopNow) for said in rig.engine.heard)


def test_with_all_places_taken_by_processes_of_its_user_a_newcomer_is_heard_to_stop(
    rig: GatewayRig,
) -> None:
    with ExitStack() as stack:
        held = crowded(rig, stack, MOST_CONNECTIONS - 1)  # the rig's own is one more
        (other,) = crowded(rig, stack, 1, GOOD + part(b'{"op":"hello","id":1}'))
        rig.step(2)
        assert b'"error":"busy"' in other.recv(65_536)
        assert is_ended(rig, other), "it leaves its room to one that stops"
        (guest,) = crowded(rig, stack, 1, GOOD + part(b'{"op":"stop","id":2}'))
        rig.until(lambda: stops_heard(rig) == 1)
        rig.step()
        assert b'"ok":true' in guest.recv(65_536)
        assert not any(is_ended(rig, one) for one in held)
        held[0].close()
        rig.step()
        poured(guest, part(b'{"op":"hello","id":3}'))
        rig.step()
        assert b'"ok":true' in guest.recv(65_536), "a place is free"


def test_a_guest_that_looked_whether_anybody_listens_is_let_in(rig: GatewayRig) -> None:
    said = GOOD + part(b'{"op":"stop"}')
    with ExitStack() as stack:
        crowded(rig, stack, MOST_CONNECTIONS - 1)
        path = str(rig.folder / "control.sock")
        subprocess.run([sys.executable, "-c", LOOK_AND_STOP, path, said.hex()], check=True)
        rig.step(2)
        assert stops_heard(rig) == 1


def test_guests_that_flood_keep_no_room_from_a_stop(rig: GatewayRig) -> None:
    flood = b"".join(part(b'{"op":"status","id":%d}' % number) for number in range(2_000))
    with ExitStack() as stack:
        crowded(rig, stack, MOST_CONNECTIONS - 1)
        crowded(rig, stack, 2 * MOST_GUESTS, GOOD + flood)
        crowded(rig, stack, 1, GOOD + part(b'{"op":"stop"}'))
        rig.step()
        assert stops_heard(rig) == 1


def test_guests_give_way_to_one_another_and_none_with_a_stop_on_its_way(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        held = crowded(rig, stack, MOST_CONNECTIONS - 1)  # the rig's own is one more
        first = crowded(rig, stack, MOST_GUESTS)
        crowded(rig, stack, 3 * MOST_GUESTS)
        assert all(is_ended(rig, one) for one in first)
        stopper, *_ = crowded(rig, stack, MOST_GUESTS)
        poured(stopper, part(b'{"op":"stop"}'))
        crowded(rig, stack, 1)
        assert stops_heard(rig) == 1
        assert not any(is_ended(rig, one) for one in held)


def test_without_a_descriptor_left_no_client_is_turned_away_for_a_newcomer(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        stopper = client(rig, stack, GOOD)
        rig.step(2)
        newcomers = [client(rig, stack, GOOD) for _ in range(3)]
        poured(stopper, part(b'{"op":"stop"}'))
        with no_descriptor_left():
            rig.step(4)
        assert stops_heard(rig) == 1
        assert not is_ended(rig, stopper)
        assert all(is_ended(rig, one) for one in newcomers)
        assert rig.counter("control_turned_away") == 3
        newcomer = client(rig, stack, GOOD)
        rig.step(2)
        assert not is_ended(rig, newcomer), "there are descriptors again"


def test_without_a_descriptor_left_the_silent_give_way_to_a_stop(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        client(rig, stack, b"")
        rig.step()
        client(rig, stack, GOOD + part(b'{"op":"stop"}'))
        with no_descriptor_left():
            rig.step(4)
        assert stops_heard(rig) == 1


def test_an_answer_of_the_engine_does_not_wait_for_all_requests(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        made = client(rig, stack, GOOD + part(b'{"op":"stop","client":"t","id":"stop"}'))
        rig.gateway.step(5)
        rig.engine.step()
        poured(made, b"".join(part(b'{"op":"status","id":%d}' % number) for number in range(9)))
        rig.gateway.step(5)
        replies = made.recv(262_144)
    assert replies.index(b'"id":"stop"') < replies.index(b'"id":3')


def asked_by_a_crowd_and_by_another(sockets: Sockets, stack: ExitStack, folder: Path) -> None:
    """Thirty connections of this process ask first, and then one of another process."""
    control = folder / "control.sock"
    for place in range(30):
        ours = stack.enter_context(connected(control))
        poured(ours, GOOD + part(b'{"op":"status","id":%d}' % place) * 2)
        sockets.look()
    theirs = stack.enter_context(connected_by_another(control))
    poured(theirs, GOOD + part(b'{"op":"status","id":"theirs"}'))
    sockets.look()


def test_processes_are_read_in_turn_however_many_connections_one_has(tmp_path: Path) -> None:
    with closing(Sockets(tmp_path)) as sockets, ExitStack() as stack:
        asked_by_a_crowd_and_by_another(sockets, stack, tmp_path)
        read = [parts[-1] for _, parts in sockets.control.take(40)]
        assert len(read) > 1
        assert b"theirs" in read[1], "one of the crowd's, one of theirs"


def test_requests_of_processes_are_handled_in_turn(tmp_path: Path) -> None:
    with closing(Sockets(tmp_path)) as sockets, ExitStack() as stack:
        asked_by_a_crowd_and_by_another(sockets, stack, tmp_path)
        requests = RequestQueue(sockets)
        for _ in range(20):
            assert not requests.look()
        handled = []
        while (waiting := requests.take()) is not None:
            handled.append(waiting[0].id)
        assert len(handled) == 61
        assert "theirs" in handled[:2]
        assert handled.index(0) < handled.index(1) < handled.index(29)


def test_replies_that_are_not_read_are_counted_and_the_client_is_still_heard(
    rig: GatewayRig,
) -> None:
    with ExitStack() as stack:
        made = client(rig, stack, GOOD)
        status, left = part(b'{"op":"status"}') * 64, b""
        while not rig.gateway.counters["replies_not_delivered"]:
            left = left or status
            left = left[max(0, poured(made, left)) :]
            rig.step()
        while left:
            left = left[max(0, poured(made, left)) :]
            rig.step()
        poured(made, part(b'{"op":"stop"}'))
        rig.until(lambda: any(isinstance(said, StopNow) for said in rig.engine.heard))


@pytest.mark.parametrize(
    "request_",
    [
        {"op": "hello", "y" * 60_000: 1},
        {"op": "y" * 60_000},
        {"op": "calibration", "do": "get", "name": "y" * 60_000},
        {"op": "open", "client": "c", "calibration": "y" * 60_000},
        {"op": "open", "client": "c", "limits": {"y" * 60_000: 1}},
        {"op": "frame", "lease": "y" * 60_000, "seq": 1},
    ],
    ids=["key", "op", "name", "calibration", "limits", "lease"],
)
def test_a_refusal_does_not_give_back_what_was_sent(
    rig: GatewayRig, request_: dict[str, object]
) -> None:
    reply = rig.ask(json.dumps(request_))

    assert not reply["ok"]
    assert len(json.dumps(reply)) < 1_000


def test_a_subscription_to_no_topic_is_ignored_and_many_are_the_end(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        made = client(rig, stack, hello("SUB"), "telemetry")
        for number in range(32):
            poured(made, part(b"\x01later%d" % number))
        poured(made, part(b"\x01sta"))
        rig.until(lambda: rig.counter("subscriptions_to_nothing") == 32)
        rig.step()
        assert b"\x05state" in made.recv(65_536)
        poured(made, part(b"\x01later"))
        rig.until(lambda: is_ended(rig, made))
    rig.until(lambda: rig.counter("telemetry_broken_off") == 1)


def test_who_subscribes_to_everything_gets_every_topic_until_it_cancels(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        made = client(rig, stack, hello("SUB") + part(b"\x01"), "telemetry")
        rig.step(2)
        assert b"\x05state" in made.recv(65_536)
        poured(made, part(b"\x00"))
        rig.step(2)
        rig.clock.t_ns += 2_000_000_000
        rig.step(2)
        with pytest.raises(BlockingIOError):
            made.recv(65_536)
    assert "state" in TOPICS


def test_reports_that_are_not_read_are_counted_and_others_get_them(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        client(rig, stack, hello("SUB") + part(b"\x01state"), "telemetry")
        reading = client(rig, stack, hello("SUB") + part(b"\x01state"), "telemetry")
        while not rig.gateway.counters["reports_not_delivered"]:
            rig.clock.t_ns += 1_000_000_001
            rig.step()
            assert b"\x05state" in reading.recv(65_536), "who reads gets each"


def test_pings_whose_answers_are_not_read_are_the_end_before_they_fill_memory(
    rig: GatewayRig,
) -> None:
    with ExitStack() as stack:
        made = client(rig, stack, GOOD)
        left = b"\x04\x07\x04PING\x00\x00" * 5_000
        while left and not rig.gateway.counters["control_broken_off"]:
            left = left[max(0, poured(made, left)) :]
            rig.step()
        rig.until(lambda: rig.gateway.counters["control_broken_off"] == 1)


def test_a_new_subscription_is_no_report_for_others(rig: GatewayRig) -> None:
    with ExitStack() as stack:
        reading = client(rig, stack, hello("SUB") + part(b"\x01state"), "telemetry")
        rig.step(2)
        assert b"\x05state" in reading.recv(65_536)
        other = client(rig, stack, hello("SUB") + part(b"\x01state"), "telemetry")
        rig.step(2)
        assert b"\x05state" in other.recv(65_536)
        with pytest.raises(BlockingIOError):
            reading.recv(65_536)
