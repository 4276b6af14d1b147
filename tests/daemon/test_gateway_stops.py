"""A stop while other requests wait: it is sent to the engine before any of them is handled."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import zmq

from etd.files import resources
from etd.files.calibration import load_calibration
from etd.gateway.inbound import InboundMessage, Unreadable, is_stop, read_request
from etd.gateway.parsed_files import MOST, ParsedFiles
from etd.gateway.request_queue import MOST_BYTES_OF_A_CLIENT, MOST_OF_A_CLIENT
from etd.protocol.errors import FileError
from etd.protocol.link import StopNow
from etd.protocol.messages import Stop
from gateway_rig import GatewayRig
from raw_client import connected, hello, part, poured

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


def test_a_file_is_parsed_once_until_it_changes(tmp_path: Path) -> None:
    path = tmp_path / "P01.toml"
    path.write_bytes(LARGE.read_bytes())
    parsed = ParsedFiles()
    first = parsed.calibration(path)
    assert parsed.calibration(path) is first
    path.write_text(LARGE.read_text().replace("width_us = 100", "width_us = 90"))
    assert parsed.calibration(path).width_us == 90
    assert parsed.calibration(path) == load_calibration(path)
    path.unlink()
    with pytest.raises(FileError):
        parsed.calibration(path)


def test_only_so_many_files_are_kept(tmp_path: Path) -> None:
    parsed, text = ParsedFiles(), resources.find("calibrations", "fake-fingertip-pad-8").read_text()
    paths = [tmp_path / f"P{number}.toml" for number in range(MOST + 1)]
    for path in paths:
        path.write_text(text)
    first = parsed.calibration(paths[0])
    for path in paths[1:]:
        last = parsed.calibration(path)
    assert parsed.calibration(paths[-1]) is last
    assert parsed.calibration(paths[0]) is not first


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
        b'{"op":"stopp"}',
        b'{"op":"note","text":"stop"}',
        b'{"op":"frame","lease":"stop","seq":1,"returns":[[0]]}',
        b'{"client":"stop"}',
        b"stop",
        b"",
    ],
)
def test_that_one_is_a_stop_is_known_before_it_is_decoded(data: bytes) -> None:
    inbound = InboundMessage(1, (b"",), 0, data)
    try:
        request: object = read_request(inbound)
    except Unreadable:
        request = None
    assert is_stop(inbound) is isinstance(request, Stop)
