"""What strangers may send: each gets a sentence that says what and where, and nothing else changes.

Owns: the table of bad input, and the property that no bytes at all get through unread.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from typing import Any

import pytest
import zmq
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from etd.protocol.link import Alive, StopNow
from etd.protocol.messages import MAX_MESSAGE_BYTES
from gateway_rig import GatewayRig

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as rig:
        yield rig


@pytest.fixture
def lease(rig: GatewayRig) -> Iterator[str]:
    token = rig.open()
    rig.engine.heard.clear()
    yield token
    rig.call(op="close", lease=token)


def frame(token: str, /, **changed: Any) -> dict[str, Any]:
    """A good frame, changed; `...` leaves a key out."""
    request = {"op": "frame", "id": 9, "lease": token, "seq": 5, "level": [0, 0.5, 1, 0]}
    return {key: value for key, value in {**request, **changed}.items() if value is not ...}


BAD_FRAMES: list[tuple[str, dict[str, Any], str, str]] = [
    ("too few values", {"level": [0, 1]}, "bad_frame", "level has 2 values, the array has 4"),
    ("too many widths", {"width_us": [50] * 5}, "bad_frame", "width_us has 5 values"),
    ("negative level", {"level": [0, -0.1, 0, 0]}, "bad_message", "level[1]"),
    ("level above one", {"level": [0, 0, 1.5, 0]}, "bad_message", "level[2]"),
    ("text for a number", {"level": [0, 0, "1", 0]}, "bad_message", "level[2]"),
    ("a truth value for a number", {"level": [0, 0, True, 0]}, "bad_message", "level[2]"),
    ("null for a number", {"level": [None, 0, 0, 0]}, "bad_message", "level[0]"),
    ("a fraction of a microampere", {"level": ..., "current_ua": [1.5, 0, 0, 0]},
     "bad_message", "current_ua[0]"),
    ("current above the code's", {"level": ..., "current_ua": [0, 10_001, 0, 0]},
     "bad_message", "current_ua[1]"),
    ("both kinds", {"current_ua": [0, 0, 0, 0]}, "bad_frame", "one of the two"),
    ("neither kind", {"level": ...}, "bad_frame", "one of the two"),
    ("an unknown key", {"levels": [0]}, "bad_message", "levels"),
    ("width too long", {"width_us": 201}, "bad_message", "width_us"),
    ("ttl too long", {"ttl_ms": 1001}, "bad_message", "ttl_ms"),
    ("unknown polarity", {"polarity": "anodal"}, "bad_message", "polarity"),
    ("a return that is not there", {"returns": [[1], [4], [0], [0]]}, "bad_frame", "0 to 3"),
    ("itself as a return", {"returns": [[1], [1], [0], [0]]}, "bad_frame", "own return"),
    ("ring without a radius", {"returns": {"ring": 2.0}}, "bad_message", "ring"),
    ("no seq", {"seq": ...}, "bad_message", "seq"),
    ("a seq that no engine can carry", {"seq": 2**63}, "bad_message", "seq"),
    ("no lease", {"lease": ...}, "bad_message", "lease"),
    ("a foreign lease", {"lease": "0" * 32}, "other_lease", "'test'"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "code", "said"), [row[1:] for row in BAD_FRAMES], ids=[row[0] for row in BAD_FRAMES]
)
def test_a_bad_frame_is_refused_with_a_sentence_and_never_reaches_the_engine(
    rig: GatewayRig, lease: str, changed: dict[str, Any], code: str, said: str
) -> None:
    reply = rig.ask(json.dumps(frame(lease, **changed)))

    assert (reply["ok"], reply["error"], reply["id"]) == (False, code, 9)
    assert said in reply["reason"]
    assert rig.engine.frames == []
    assert rig.call(**frame(lease))["ok"], "the lease and its seq are as before"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "from { on"),
        (b"[1]", "from { on"),
        (b' {"op":"hello"}', "from { on"),
        (b"\xff\xfe", "from { on"),
        (b'{"op":"hello"', "not a JSON object"),
        (b'{"op":"hello"} x', "not a JSON object"),
        (b'{"op":"keep","lease":"\xff"}', "not a JSON object"),
        (b'{"op":"frame","lease":"a","seq":1,"level":[NaN]}', "NaN"),
        (b'{"op":"frame","lease":"a","seq":1,"level":[0, -Infinity]}', "NaN"),
        (b'{"op":"frame","lease":"a","seq":1,"level":[1e999]}', "out of range"),
        (b'{"op":"frame","lease":"a","seq":1,"returns":' + b"[" * 30_000, "returns"),
        (b'{"id":' + b"[" * 30_000, "not a JSON object"),
        (b"{}", "op"),
        (b'{"op":3}', "op"),
        (b'{"op":"hello","id":[1]}', "id"),
        (b'{"op":"hello","id":' + b"9" * 40 + b"}", "id"),
        (b'{"op":"open","client":""}', "client"),
        (b'{"op":"calibration","do":"get","name":"../x"}', "name"),
    ],
)
def test_what_is_no_request_is_refused_and_counted(rig: GatewayRig, data: bytes, said: str) -> None:
    before = rig.counter("malformed")

    reply = rig.ask(data)

    assert (reply["ok"], reply["error"]) == (False, "bad_message")
    assert said in reply["reason"]
    assert rig.counter("malformed") == before + 1


@pytest.mark.parametrize("unshown", ["\n", "\x1b[31m", "\x7f", "\x9b", "\u2028", "\u202e"])
def test_text_that_forges_what_is_shown_is_refused_and_never_reaches_the_engine(
    rig: GatewayRig, unshown: str
) -> None:
    limits = {"max_current_ua": 900, "width_us": 50}
    for request in (
        {"op": "open", "client": f"x{unshown}", "limits": limits},
        {"op": "open", "client": "x", "calibration": f"x{unshown}"},
        {"op": "calibration", "do": "get", "name": f"x{unshown}"},
        {"op": "hello", f"x{unshown}": 1},
    ):
        rig.engine.heard.clear()
        reply = rig.call(**request)
        assert reply["error"] == "bad_message"
        assert reply["reason"].isprintable()
        assert "2066" not in reply["reason"], "words, not the pattern"
        assert not [said for said in rig.engine.heard if not isinstance(said, Alive)]


@pytest.mark.parametrize(
    "spoiled",
    [
        {"client": "x\n\x1b[31metd main: ARMED"},
        {"client": "x" * 65},
        {"client": 7},
        {"clients": ""},
    ],
)
def test_a_stop_stops_whatever_else_is_wrong_with_it_and_names_the_sender_by_the_kernel(
    rig: GatewayRig, spoiled: dict[str, Any]
) -> None:
    rig.engine.heard.clear()

    assert rig.call(op="stop", id="x", **spoiled)["ok"]

    (stop,) = [said for said in rig.engine.heard if isinstance(said, StopNow)]
    assert stop.client == f"user {os.getuid()}"


def test_the_electrode_is_a_field_of_the_refusal(rig: GatewayRig, lease: str) -> None:
    assert rig.call(**frame(lease, level=[0, 0, 0, -1]))["electrode"] == 3


def test_an_unknown_op_is_told_which_there_are(rig: GatewayRig) -> None:
    reply = rig.call(op="levels", id="x")

    assert (reply["error"], reply["id"]) == ("unknown_op", "x")
    assert "frame" in reply["reason"]


def test_a_seq_that_does_not_rise_is_refused(rig: GatewayRig, lease: str) -> None:
    assert rig.call(**frame(lease, seq=7))["ok"]

    for seq in (7, 6, 0):
        assert rig.call(**frame(lease, seq=seq))["error"] == "old_seq"
    assert rig.call(**frame(lease, seq=8))["ok"]


def test_a_message_over_the_size_limit_ends_only_the_connection_that_sent_it(
    rig: GatewayRig,
) -> None:
    before = rig.counter("control_disconnects")
    big = rig.socket(zmq.DEALER, "control.sock")
    big.send(b'{"op":"hello","x":"' + b"a" * MAX_MESSAGE_BYTES + b'"}')

    rig.until(lambda: rig.counter("control_disconnects") > before)

    assert not big.poll(0)
    assert rig.call(op="hello")["ok"]
    big.close()


@pytest.mark.parametrize(("kind", "name"), [(zmq.DEALER, "control"), (zmq.PUSH, "frames")])
def test_of_one_connection_a_few_messages_are_kept_while_nobody_reads(
    rig: GatewayRig, kind: int, name: str
) -> None:
    with rig.context.socket(kind) as flooding:
        flooding.setsockopt(zmq.LINGER, 0)
        flooding.setsockopt(zmq.SNDHWM, 1)
        flooding.connect(f"ipc://{rig.folder}/{name}.sock")
        taken = 0
        while taken < 100 and flooding.poll(200, zmq.POLLOUT):
            flooding.send(b"x" * 60_000)
            taken += 1

    assert taken < 12, "its own queue and the kernel's buffer keep some, the gateway two"
    assert rig.call(op="hello")["ok"], "it is served again"


def test_a_message_of_exactly_the_size_limit_is_read(rig: GatewayRig) -> None:
    data = b'{"op":"hello","x":"'.ljust(MAX_MESSAGE_BYTES - 2, b"a") + b'"}'

    assert "unknown field `x`" in rig.ask(data)["reason"]


def test_parts_that_mean_nothing_are_refused(rig: GatewayRig) -> None:
    rig.control.send_multipart([b"frame", b'{"op":"hello"}'])
    assert rig.reply()["error"] == "bad_message"


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=12,
)
requests = st.fixed_dictionaries(
    {"op": st.sampled_from(["frame", "keep", "disarm", "close", "mark", "measure"])},
    optional={
        "id": json_values,
        "lease": st.text(max_size=40),
        "seq": st.integers(),
        "level": json_values,
        "current_ua": st.lists(st.integers(), max_size=6),
        "returns": json_values,
        "tag": st.integers(),
    },
).map(lambda request: json.dumps(request).encode())


@settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.binary(max_size=200) | json_values.map(lambda v: json.dumps(v).encode()) | requests)
def test_no_bytes_crash_the_gateway_or_reach_the_engine(rig: GatewayRig, data: bytes) -> None:
    rig.engine.heard.clear()

    assert rig.ask(data)["ok"] is False
    assert rig.engine.heard == []


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(batch=st.lists(st.binary(max_size=100) | requests, min_size=1, max_size=8))
def test_no_streamed_bytes_crash_the_gateway_or_reach_the_engine(
    rig: GatewayRig, batch: list[bytes]
) -> None:
    rig.engine.heard.clear()
    with rig.socket(zmq.PUSH, "frames.sock") as stream:
        for data in batch:
            stream.send(data)
        rig.step(2)

    assert rig.call(op="hello")["ok"]
    assert rig.engine.heard == []
