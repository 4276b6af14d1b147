"""Small messages that decode to much: what the gateway keeps of them is bounded by their bytes.

Owns: bombs of each form that a message can have, and what is left of them in memory. An array in
JSON is a few bytes an element; decoded, an element takes fifty.
"""

from __future__ import annotations

import socket
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import msgspec
import pytest

from etd.files.calibration import load_calibration
from etd.files.resources import find
from etd.gateway.last_frames import LastFrames
from etd.protocol.calibration import Calibration
from etd.protocol.frame import MAX_ELECTRODES, Frame
from etd.protocol.messages import MAX_MESSAGE_BYTES, FrameRequest
from gateway_rig import GatewayRig
from raw_client import connected, hello, part, poured

pytestmark = pytest.mark.slow

#: As many as fit into a message.
MANY = 16_300
ONE_MORE = MAX_ELECTRODES + 1
#: The largest frame that decodes: each of as many electrodes names as many others as fit.
LARGEST = b'{"op":"frame","lease":"x","seq":1,"returns":[%s]}' % b",".join(
    [b"[%s]" % b",".join([b"257"] * 63)] * MAX_ELECTRODES
)
MB = 1_000_000
#: More than the kernel takes of a connection, and fewer than may wait.
LONG_REPLIES = 40


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as rig:
        yield rig


@pytest.fixture
def grown() -> Iterator[Callable[[], int]]:
    """By how many bytes what Python holds has grown."""
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    yield lambda: tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()


@pytest.mark.parametrize(
    "field",
    [
        {"level": [0.5] * ONE_MORE},
        {"current_ua": [1] * ONE_MORE},
        {"width_us": [100] * ONE_MORE},
        {"polarity": ["anodic"] * ONE_MORE},
        {"rate_hz": [60.0] * ONE_MORE},
        {"returns": [[0]] * ONE_MORE},
        {"returns": [[0] * ONE_MORE]},
    ],
    ids=lambda field: next(iter(field)),
)
def test_no_array_of_a_frame_is_longer_than_an_array_has_electrodes(
    rig: GatewayRig, field: dict[str, Any]
) -> None:
    refused = rig.call(op="frame", lease=rig.open(), seq=1, **field)
    assert refused["error"] == "bad_message"
    assert f"{MAX_ELECTRODES}" in refused["reason"]
    with pytest.raises(msgspec.ValidationError, match=f"<= {MAX_ELECTRODES}"):
        msgspec.convert({"lease": "x", "seq": 1, **field}, Frame)


@pytest.mark.parametrize(
    "field",
    [{"returns": [[0]] * ONE_MORE}, {"returns": [[0] * ONE_MORE]}, {"electrode": ONE_MORE}],
    ids=["returns", "members", "electrodes"],
)
def test_nor_one_of_a_calibration(field: dict[str, Any]) -> None:
    whole = msgspec.to_builtins(load_calibration(find("calibrations", "fake-fingertip")))
    if "electrode" in field:
        field = {"electrode": whole["electrode"][:1] * ONE_MORE}
    with pytest.raises(msgspec.ValidationError, match=f"<= {MAX_ELECTRODES}"):
        msgspec.convert({**whole, **field}, Calibration)


def test_a_frames_token_is_as_short_as_that_of_every_request(rig: GatewayRig) -> None:
    refused = rig.call(op="frame", lease="x" * 65, seq=1, current_ua=[1])
    assert refused["error"] == "bad_message"
    assert "lease" in refused["reason"]


@pytest.mark.parametrize(
    "frame",
    [
        LARGEST,
        b'{"op":"frame","lease":"x","seq":1,"returns":[%s]}' % b",".join([b"[0]"] * MANY),
        b'{"op":"frame","lease":"x","seq":1,"returns":[[%s]]}' % b",".join([b"300"] * MANY),
        b'{"op":"frame","lease":"x","seq":1,"level":[%s]}' % b",".join([b"0.5"] * MANY),
    ],
    ids=["largest", "lists", "members", "levels"],
)
def test_of_a_strangers_frames_nothing_is_kept(
    rig: GatewayRig, grown: Callable[[], int], frame: bytes
) -> None:
    assert len(frame) < MAX_MESSAGE_BYTES
    rig.open()
    begun = grown()
    for _ in range(20):
        assert rig.ask(frame)["error"] in ("bad_message", "other_lease")
    assert grown() - begun < MB


def test_frames_of_the_holder_are_kept_as_bytes(grown: Callable[[], int]) -> None:
    """Of all that have room, each the largest."""
    frame = msgspec.json.decode(LARGEST, type=FrameRequest)
    plain = Frame(lease=frame.lease, seq=frame.seq, returns=frame.returns)
    kept, begun = LastFrames(), grown()
    for _ in range(300):
        kept.add(plain)
    assert grown() - begun < 256 * MAX_MESSAGE_BYTES
    assert list(kept.since("x", 1)) == [plain] * 256
    assert list(kept.since("x", 2)) == list(kept.since("another", 1)) == []


def test_what_waits_takes_no_more_than_its_bytes(grown: Callable[[], int]) -> None:
    """Clients that do not read the long replies to short requests, and then send the largest."""
    clients = 10
    shipped = find("calibrations", "fake-fingertip").parent
    with GatewayRig(shipped_calibrations=shipped) as rig, ExitStack() as stack:
        made = [stack.enter_context(connected(rig.folder / "control.sock")) for _ in range(clients)]
        asked = part(b'{"op":"calibration","do":"get","name":"fake-fingertip"}')
        left = dict.fromkeys(made, hello("DEALER") + asked * LONG_REPLIES)
        _poured(rig, left)
        begun = grown()
        left = dict.fromkeys(made, part(LARGEST))
        sent = _poured(rig, left)
        assert sent == clients * len(part(LARGEST))
        held = grown() - begun
        assert rig.call(op="status")["status"]["counters"].get("refused_busy", 0) == 0
        assert 0.9 * sent < held < 1.5 * sent, "they wait, as bytes"
        assert rig.call(op="stop")["ok"]


def _poured(rig: GatewayRig, left: dict[socket.socket, bytes]) -> int:
    sent = 0
    while any(left.values()):
        for each, data in left.items():
            count = poured(each, data)
            assert count >= 0, "it was closed"
            left[each] = data[count:]
            sent += count
        rig.step(5)
    rig.step(LONG_REPLIES * len(left))
    return sent
