"""Streamed frames: the newest is shown, and nothing goes missing without a count.

Owns: superseding, refusing and reporting on the frames socket.
"""

from __future__ import annotations

import json
from contextlib import closing
from typing import Any

import pytest
import zmq

from etd.protocol.link import ArmBoard
from gateway_rig import GatewayRig


def frame(lease: str, seq: int, **extra: Any) -> bytes:
    body = {"op": "frame", "lease": lease, "seq": seq, "level": [0, 0, 0, 1], **extra}
    return json.dumps(body).encode()


def test_of_the_frames_of_one_turn_the_newest_is_passed_on_and_the_rest_counted() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        stream = rig.socket(zmq.PUSH, "frames.sock")
        for seq in range(1, 41):
            stream.send(frame(lease, seq))

        rig.until(lambda: bool(rig.engine.frames) and rig.engine.frames[-1].frame.seq == 40)

        seqs = [sent.frame.seq for sent in rig.engine.frames]
        assert seqs == sorted(seqs)
        assert len(seqs) + rig.counter("superseded") == 40
        assert all(sent.ref == 0 for sent in rig.engine.frames)


def test_a_frame_that_is_older_than_the_one_before_it_is_never_passed_on() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        stream = rig.socket(zmq.PUSH, "frames.sock")
        for seq in (5, 4):
            stream.send(frame(lease, seq))

        rig.until(lambda: rig.counter("superseded") + rig.counter("refused_old_seq") == 1)

        assert [sent.frame.seq for sent in rig.engine.frames] == [5]


def test_another_clients_frames_do_not_supersede_the_holders() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        mine = rig.socket(zmq.PUSH, "frames.sock")
        other = rig.socket(zmq.PUSH, "frames.sock")
        mine.send(frame(lease, 1))
        for seq in range(2, 12):
            other.send(frame("f" * 32, seq))

        rig.until(lambda: rig.counter("refused_other_lease") == 10)

        assert [sent.frame.seq for sent in rig.engine.frames] == [1]
        assert rig.counter("superseded") == 0


@pytest.mark.parametrize(("holds", "why"), [(True, "bad_message"), (False, "other_lease")])
def test_the_arrays_of_a_frame_are_decoded_for_the_holder_of_the_lease_alone(
    holds: bool, why: str
) -> None:
    """A frame of another lease is refused for its lease, although it has too many levels."""
    with GatewayRig() as rig:
        lease = rig.open()
        stream = rig.socket(zmq.PUSH, "frames.sock")
        stream.send(frame(lease if holds else "f" * 32, 1, level=[0] * 300))
        stream.send(frame(lease, 2))

        rig.until(lambda: bool(rig.engine.frames))

        counters = rig.call(op="status")["status"]["counters"]
        assert [name for name in counters if name.startswith("refused_")] == [f"refused_{why}"]


@pytest.mark.parametrize("seq", ["", ',"seq":1.5', ',"seq":"1"'])
def test_nor_are_they_for_a_frame_that_has_no_number(seq: str) -> None:
    """The refusal is of the number, whatever comes before it."""
    with GatewayRig() as rig, closing(rig.context.socket(zmq.SUB)) as socket:
        lease = rig.open()
        socket.setsockopt(zmq.SUBSCRIBE, b"refused")
        socket.connect(f"ipc://{rig.folder}/telemetry.sock")
        stream = rig.socket(zmq.PUSH, "frames.sock")
        rig.step(20)
        stream.send_string(f'{{"lease":"{lease}","level":{[0] * 300}{seq}}}')

        rig.until(lambda: bool(socket.poll(0)))

        report = json.loads(socket.recv_multipart()[1])
        assert report["error"] == "bad_message"
        assert "seq" in report["reason"]


def test_a_refused_streamed_frame_is_reported_to_everybody() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        socket = rig.context.socket(zmq.SUB)
        socket.setsockopt(zmq.SUBSCRIBE, b"refused")
        socket.setsockopt(zmq.SUBSCRIBE, b"state")
        socket.connect(f"ipc://{rig.folder}/telemetry.sock")
        rig.until(lambda: bool(socket.poll(0)))
        socket.setsockopt(zmq.UNSUBSCRIBE, b"state")
        socket.recv_multipart()
        stream = rig.socket(zmq.PUSH, "frames.sock")
        stream.send(frame(lease, 4, level=[0, 0]))

        rig.until(lambda: bool(socket.poll(0)))

        topic, body = socket.recv_multipart()
        report = json.loads(body)
        assert topic == b"refused"
        assert (report["error"], report["seq"], report["count"]) == ("bad_frame", 4, 1)
        assert "2 values" in report["reason"]


def test_frames_that_the_engine_does_not_take_are_counted_and_may_be_sent_again() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        rig.engine.is_reading = False
        channels = rig.gateway._engine._channels
        assert channels is not None
        while channels[1].send(ArmBoard()):
            pass
        stream = rig.socket(zmq.PUSH, "frames.sock")
        stream.send(frame(lease, 1))

        rig.until(lambda: rig.gateway.counters["refused_busy"] == 1)
        rig.engine.hang_up()
