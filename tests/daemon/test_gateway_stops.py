"""A stop while other requests wait: it is sent to the engine before any of them is handled."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import re
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
import zmq

from etd.files import resources
from etd.gateway.inbound import InboundMessage, Unreadable, is_stop, read_request
from etd.gateway.record_file import Disk
from etd.gateway.request_queue import RequestQueue
from etd.gateway.server import BYTES_A_TURN
from etd.gateway.sockets import Sockets
from etd.gateway.waiting import MOST_BYTES_OF_A_CLIENT, MOST_BYTES_OF_A_USER, MOST_OF_A_CLIENT
from etd.protocol.link import StopNow
from etd.protocol.messages import Stop
from gateway_rig import GatewayRig
from raw_client import connected, connected_by_others, hello, part, poured

pytestmark = pytest.mark.slow

LARGE = resources.find("calibrations", "fake-fingertip-grid-16x16")
SMALL = resources.find("calibrations", "fake-fingertip-pad-8")


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as made:
        yield made


def stored(rig: GatewayRig, name: str, shipped: Path = LARGE) -> None:
    folder = rig.state_dir / "calibrations"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.toml").write_bytes(shipped.read_bytes())


def other(rig: GatewayRig) -> zmq.Socket[bytes]:
    """Another client, that the gateway knows."""
    socket = rig.socket(zmq.DEALER, "control.sock")
    socket.send(b'{"op": "status"}')
    rig.until(lambda: bool(socket.poll(0)))
    assert rig.reply(socket)["ok"]
    return socket


def stops(rig: GatewayRig) -> int:
    return sum(isinstance(command, StopNow) for command in rig.engine.heard)


@pytest.mark.parametrize(
    ("asked", "in_reply"),
    [
        (b'{"op": "calibration", "do": "get", "name": "small"}', b'"calibration":{'),
        (b'{"op": "hello"}', b'"body_site":"'),
    ],
    ids=["a file", "the list of them"],
)
def test_of_several_slow_requests_one_is_handled_in_a_turn_and_stops_are_before_each(
    rig: GatewayRig, asked: bytes, in_reply: bytes
) -> None:
    """Written to the sockets themselves: what was written is there with the next look."""
    stored(rig, "small", SMALL)
    path = rig.folder / "control.sock"
    with closing(connected(path)) as asker, closing(connected(path)) as stopper:
        for client in (asker, stopper):
            poured(client, hello("DEALER"))
        rig.step(3)
        poured(asker, part(asked) * 8)
        rig.step()
        poured(stopper, part(b'{"op": "stop"}'))
        rig.step()
        assert stops(rig) == 1
        answered = asker.recv(1_000_000).count(in_reply)
        assert answered == 2, "one in each turn"


def test_a_stop_that_comes_during_a_slow_request_is_sent_in_the_same_turn() -> None:
    class WatchedDisk(Disk):
        """It is asked while a record is begun."""

        def free_bytes(self, folder: Path) -> int:
            poured(stopper, part(b'{"op": "stop"}'))
            return super().free_bytes(folder)

    with GatewayRig(disk=WatchedDisk()) as rig, ExitStack() as stack:
        path = rig.folder / "control.sock"
        asker, stopper = (stack.enter_context(closing(connected(path))) for _ in range(2))
        for client in (asker, stopper):
            poured(client, hello("DEALER"))
        rig.step(3)
        poured(asker, part(b'{"op": "record", "do": "start", "name": "long"}'))
        rig.gateway.step(5)
        rig.engine.step()
        assert stops(rig) == 1


def test_a_client_that_reads_no_replies_is_answered_in_order_once_it_does(
    rig: GatewayRig,
) -> None:
    stored(rig, "large")
    asked = b'{"op": "calibration", "do": "get", "name": "large", "id": %d}'
    with closing(connected(rig.folder / "control.sock")) as slow:
        poured(slow, hello("DEALER") + b"".join(part(asked % number) for number in range(40)))
        rig.step(60)
        assert rig.call(op="status")["ok"], "nobody else waits for it"
        read = bytearray()
        for _ in range(400):
            rig.step()
            with contextlib.suppress(BlockingIOError):
                while data := slow.recv(65_536):
                    read += data
            if read.count(b'"id":') == 40:
                break
        found = [int(number) for number in re.findall(rb'"id":(\d+)', bytes(read))]
        assert found == list(range(40)), "none is lost"


def test_a_stop_is_read_while_the_queue_is_full(rig: GatewayRig) -> None:
    """What a flooding client gets no room for is refused to it alone."""
    stopper = other(rig)
    text = "x" * 60_000
    most = 4 * MOST_BYTES_OF_A_CLIENT // 60_000
    flooders = [rig.socket(zmq.DEALER, "control.sock") for _ in range(4)]
    for flooder in flooders:
        for number in range(most):
            flooder.send(json.dumps({"op": "note", "text": text, "id": number}).encode())
    rig.gateway.step(100)
    stopper.send(b'{"op": "stop"}')
    turns = 0
    while not stops(rig):
        rig.step()
        turns += 1
    assert turns < 20


def test_a_client_that_sends_more_than_it_is_answered_is_refused_with_its_id(
    rig: GatewayRig,
) -> None:
    stored(rig, "large")
    for number in range(MOST_OF_A_CLIENT + 20):
        rig.control.send(b'{"op": "calibration", "do": "get", "name": "large", "id": %d}' % number)
    replies = {}
    for _ in range(MOST_OF_A_CLIENT + 20):
        rig.until(lambda: bool(rig.control.poll(0)))
        reply = rig.reply()
        replies[reply["id"]] = reply.get("error")
    assert set(replies) == set(range(MOST_OF_A_CLIENT + 20)), "each has one reply"
    assert set(replies.values()) <= {None, "busy"}
    assert replies[0] is None


def status(number: int) -> bytes:
    return part(b'{"op":"status","id":%d}' % number)


#: What a connection of a flood sends over and over.
FLOODS = {
    "short requests": b"".join(status(number) for number in range(200)),
    "long requests": part(b'{"op":"' + b"y" * 60_000 + b'"}') * 3,
    "half a request": part(b'{"op":"' + b"y" * 60_000 + b'"}')[:-1],
    "heartbeats": b"\x04\x07\x04PING\x00\x00" * 200,
    "parts that are no request": (part(b"y" * 30_000, more=True) + part(b"")) * 3,
}


@pytest.mark.parametrize("flood", FLOODS.values(), ids=FLOODS)
@pytest.mark.parametrize("already_asked", [0, 3])
def test_a_stop_among_seventy_processes_of_its_own_user_is_found_before_the_next_request(
    tmp_path: Path, flood: bytes, already_asked: int
) -> None:
    """Whether they have just begun or are at it: what they send is there before each look."""
    with closing(Sockets(tmp_path)) as sockets, ExitStack() as stack:
        requests, control = RequestQueue(sockets), tmp_path / "control.sock"
        flooding = []
        for made in connected_by_others(control, 70):
            flooding.append(stack.enter_context(made))
            poured(made, hello("DEALER"))
            requests.look()
        unsent = dict.fromkeys(flooding, flood)

        def looked() -> None:
            for client in flooding:
                unsent[client] = unsent[client][max(0, poured(client, unsent[client])) :] or flood
            requests.look()

        for round_ in range(60):
            if round_ % 10 == 0:
                stopper = stack.enter_context(connected(control))
                poured(stopper, hello("DEALER"))
                looked()
                poured(stopper, b"".join(status(number) for number in range(already_asked)))
                for _ in range(already_asked):
                    looked()
                poured(stopper, part(b'{"op":"stop"}'))
                looked()
                assert requests.take_stop() is not None, round_
            looked()
            requests.take()


def test_a_stop_with_its_handshake_is_found_at_once(tmp_path: Path) -> None:
    with closing(Sockets(tmp_path)) as sockets, ExitStack() as stack:
        requests = RequestQueue(sockets)
        stopper = stack.enter_context(connected(tmp_path / "control.sock"))
        poured(stopper, hello("DEALER") + part(b'{"op":"stop"}'))
        requests.look()
        assert requests.take_stop() is not None


def test_of_clients_that_leave_only_so_much_waits(tmp_path: Path) -> None:
    """Each time another connection: the bound is the user's."""
    long = part(b'{"op":"' + b"y" * 60_000 + b'"}')
    with closing(Sockets(tmp_path)) as sockets, ExitStack() as stack:
        requests, refusals = RequestQueue(sockets), 0
        for _ in range(MOST_BYTES_OF_A_USER // 60_000 + 50):
            with closing(connected(tmp_path / "control.sock")) as leaving:
                left = hello("DEALER") + long
                while left:
                    left = left[poured(leaving, left) :]
                    refusals += len(requests.look())
            for _ in range(5):
                refusals += len(requests.look())
        assert refusals >= 50
        stopper = stack.enter_context(connected(tmp_path / "control.sock"))
        poured(stopper, hello("DEALER") + part(b'{"op":"stop"}'))
        requests.look()
        assert requests.take_stop() is not None
        handled = 0
        while requests.take() is not None:
            handled += 1
        assert handled * 60_000 < MOST_BYTES_OF_A_USER
        poured(stopper, status(1))
        assert not requests.look(), "there is room again"


def test_all_parts_count_among_what_waits(tmp_path: Path) -> None:
    asked = (part(b"y" * 60_000, more=True) + status(1)) * 8
    with closing(Sockets(tmp_path)) as sockets, ExitStack() as stack:
        requests, refusals = RequestQueue(sockets), 0
        asking = stack.enter_context(connected(tmp_path / "control.sock"))
        left = hello("DEALER") + asked
        while left:
            left = left[poured(asking, left) :]
            refusals += len(requests.look())
        for _ in range(200):
            refusals += len(requests.look())
        assert refusals == 8 - MOST_BYTES_OF_A_CLIENT // 60_000


def most_in_a_turn(rig: GatewayRig, name: str, left: bytes, counter: str, until: int) -> int:
    """Of what is poured into the socket of that name, until so many are counted."""
    with closing(connected(rig.folder / name)) as flooding:
        counts = [0]
        while left or counts[-1] < until:
            left = left[max(0, poured(flooding, left)) :] if left else b""
            rig.gateway.step(5)
            counts.append(rig.gateway.counters[counter])
        return max(after - before for before, after in itertools.pairwise(counts))


def test_a_turn_decodes_one_long_frame_and_then_looks_for_stops(rig: GatewayRig) -> None:
    long = part(
        b'{"op":"frame","lease":"%s","seq":1,"level":[%s]}'
        % (rig.open().encode(), b",".join([b"0.5"] * 16_000))
    )
    left = hello("PUSH") + long * 3
    assert most_in_a_turn(rig, "frames.sock", left, "refused_bad_message", 3) == 1


def test_of_requests_too_a_turn_handles_so_many_bytes(rig: GatewayRig) -> None:
    """Others' frames and the telemetry do not wait for what a client pours."""
    request = b'{"op":"frame","lease":"x","seq":1,"returns":[%s]}' % b",".join([b"[0]"] * 250)
    left = hello("DEALER") + part(request) * 60
    most = math.ceil(BYTES_A_TURN / len(request))
    assert most_in_a_turn(rig, "control.sock", left, "refused_no_lease", 60) <= most


def test_what_only_has_a_reply_is_not_done_for_a_client_that_has_left(rig: GatewayRig) -> None:
    """What it asked to be done is."""
    with closing(connected(rig.folder / "control.sock")) as leaving:
        left = hello("DEALER") + part(b'{"op":"hello"}') * 60 + part(b'{"op":"stop"}')
        assert poured(leaving, left) == len(left)
    rig.step(100)
    assert rig.gateway.counters["left_before_the_reply"] > 50
    assert stops(rig) == 1


@pytest.mark.parametrize(
    "data",
    [
        b'{"op":"stop"}',
        b' {"op":"stop"}',
        b'{"op":"st\\u006fp","id":1}',
        b'{"op":"status","op":"stop"}',
        b'{"op":"stop","op":"status"}',
        b'{"op":5,"op":"stop"}',
        b'{"op":"stop","client":5}',
        b'{"op":"stop","client":"\\ud800"}',
        b'{"op":"stop","client":"\xff"}',
        b'{"op":"stop"',
        b'{"x":{"y":1},"op":"stop"',
        b'{"client":"my {best} display","op":"stop","id":nan}',
        b'{"op":"note","text":{"op":"stop"}}',
        b'{"say \\"op":"stop"}',
        b'{"op":"stopp"}',
        b'{"op":"note","text":"stop"}',
        b'{"op":"frame","lease":"stop","seq":1,"returns":[[0]]}',
        b'{"client":"stop"}',
        b"stop",
        b"",
    ],
)
@pytest.mark.parametrize("route", [(), (b"",), (b"x",), (b"", b"")])
def test_that_one_is_a_stop_is_known_before_it_is_decoded(
    data: bytes, route: tuple[bytes, ...]
) -> None:
    inbound = InboundMessage(1, route, 0, data)
    try:
        request: object = read_request(inbound)
    except Unreadable:
        request = None
    assert is_stop(inbound) is isinstance(request, Stop)


@pytest.mark.parametrize(
    "data",
    [
        b'\n{"client":{"a":1},"op":"stop"}',
        b' {"id":5,"x":[{"a":1}],"op":"stop"}',
        b'\xef\xbb\xbf{"op":"stop","client":"with a mark in front"}',
    ],
)
def test_nothing_in_front_of_it_hides_a_stop(data: bytes) -> None:
    assert isinstance(read_request(InboundMessage(1, (), 0, data)), Stop)


def test_a_stop_that_a_proxy_has_passed_on_is_heeded_and_answered_the_same_way(
    rig: GatewayRig,
) -> None:
    """A proxy puts the client's address before it."""
    socket = rig.socket(zmq.DEALER, "control.sock")
    socket.send_multipart([b"a client", b"", b'{"op":"stop","id":7}'])
    rig.until(lambda: stops(rig) == 1)
    socket.send_multipart([b"a client", b"", b'{"op":"status"}'])
    replies: list[list[bytes]] = []
    while len(replies) < 2:
        rig.until(lambda: socket.poll(0) != 0)
        replies.append(socket.recv_multipart())
    assert [reply[:2] for reply in replies] == [[b"a client", b""]] * 2
    refused = [reply for reply in replies if b"bad_message" in reply[2]]
    assert len(refused) == 1
    assert b"must be one part" in refused[0][2]
