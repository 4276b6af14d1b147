"""The gateway and its engine: signs of life, stop before all else, and an engine that ends.

Owns: what the gateway says and does when the engine is there, stuck, or gone.
"""

from __future__ import annotations

import json
import os
from typing import Any

import pytest
import zmq

from etd.gateway.stops import ANSWERED_WITHIN_NS
from etd.protocol.link import ArmBoard, PulseBatch, Report, StopNow
from etd.protocol.messages import Marked, RefusedReport
from etd.protocol.pulse_row import ROW_BYTES
from gateway_rig import PATIENCE, GatewayRig
from raw_client import connected, hello, part
from scripted_engine import ScriptedEngine, full_answer


def subscribe(rig: GatewayRig, *topics: str) -> zmq.Socket[bytes]:
    socket = rig.context.socket(zmq.SUB)
    for topic in (*topics, "state"):
        socket.setsockopt(zmq.SUBSCRIBE, topic.encode())
    socket.connect(f"ipc://{rig.folder}/telemetry.sock")
    rig.until(lambda: bool(socket.poll(0)))
    socket.recv_multipart()
    return socket


def heard(rig: GatewayRig, socket: zmq.Socket[bytes], topic: str) -> dict[str, Any]:
    """The next report of this topic."""
    while True:
        rig.until(lambda: bool(socket.poll(0)))
        got, body = socket.recv_multipart()
        if got == topic.encode():
            report = json.loads(body)
            assert isinstance(report, dict)
            return report


def test_the_engine_hears_from_its_gateway_twenty_times_a_second() -> None:
    with GatewayRig() as rig:
        rig.step(3)
        before = rig.engine.alive
        for _ in range(10):
            rig.clock.t_ns += 50_000_000
            rig.step()
        rig.step()

        assert rig.engine.alive - before == 10


def test_a_newcomer_is_greeted_with_state_at_once_and_then_each_second() -> None:
    with GatewayRig() as rig:
        socket = subscribe(rig)
        rig.step(5)
        assert not socket.poll(0)

        rig.clock.t_ns += 1_000_000_000

        assert heard(rig, socket, "state")["engine"] == "there"


def test_an_engine_that_reports_nothing_is_told_as_silent_until_it_reports_again() -> None:
    with GatewayRig() as rig:
        socket = subscribe(rig)
        rig.clock.t_ns += 2_900_000_000
        assert heard(rig, socket, "state")["engine"] == "there"
        rig.clock.t_ns += 1_000_000_000
        told = heard(rig, socket, "state")
        assert (told["engine"], told["state"]) == ("silent", "SAFE")

        rig.engine.report_state()

        assert heard(rig, socket, "state")["engine"] == "there"


def test_a_mark_is_published_at_once() -> None:
    with GatewayRig() as rig:
        socket = subscribe(rig, "mark")
        rig.engine.say(Report(mark=Marked(marked_ns=42, tag="begin block 2", sync=True)))
        assert heard(rig, socket, "mark") == {"marked_ns": 42, "tag": "begin block 2", "sync": True}


def test_a_stop_goes_out_before_what_came_earlier() -> None:
    with GatewayRig() as rig:
        for _ in range(PATIENCE):
            rig.engine.heard.clear()
            for _ in range(3):
                rig.control.send(b'{"op":"arm"}')
            rig.control.send(b'{"op":"stop","client":"me"}')
            # The answers of the try before; and time for all four to be there at the next turn.
            while rig.control.poll(20):
                rig.control.recv()
            rig.gateway.step(1000)
            rig.engine.step()
            if len(rig.engine.heard) == 4:  # all four came in one turn
                break
            rig.until(lambda: len(rig.engine.heard) == 4)

        assert isinstance(rig.engine.heard[0], StopNow)
        assert rig.engine.heard[0].client == f"'me' (user {os.getuid()})"
        assert all(isinstance(command, ArmBoard) for command in rig.engine.heard[1:])


def test_a_stop_that_the_engine_does_not_take_cuts_the_link() -> None:
    with GatewayRig() as rig:
        rig.engine.is_reading = False
        channels = rig.gateway._engine._channels
        assert channels is not None
        while channels[0].send(ArmBoard()):
            pass

        reply = rig.call(op="stop")

        assert reply["error"] == "engine_gone"
        assert "its link was closed" in reply["reason"]
        rig.engine.is_reading = True
        rig.until(lambda: not rig.engine.is_connected)


def test_a_stop_that_the_engine_does_not_answer_in_time_cuts_the_link() -> None:
    with GatewayRig() as rig:
        rig.engine.answer = lambda _: None
        rig.control.send(b'{"op":"arm","id":1}')
        rig.until(lambda: len(rig.engine.heard) == 1)
        rig.control.send(b'{"op":"stop","id":2}')
        rig.until(lambda: len(rig.engine.heard) == 2)
        rig.clock.t_ns += ANSWERED_WITHIN_NS - 1
        rig.step(3)
        assert rig.engine.is_connected
        assert not rig.control.poll(0)
        rig.clock.t_ns += 1

        def answered(**request: object) -> dict[str, Any]:
            if request:
                rig.control.send(json.dumps(request).encode())
            rig.until_gateway(lambda: bool(rig.control.poll(0)))
            return dict(json.loads(rig.control.recv()))

        stopped, armed = sorted((answered(), answered()), key=lambda reply: -reply["id"])
        assert stopped["error"] == armed["error"] == "engine_gone"
        assert "did not answer the stop, so its link was closed" in stopped["reason"]
        assert "etd safe" in stopped["reason"]
        assert "whether it runs is not known" in armed["reason"]
        for op in ("hello", "arm"):
            assert "whether it runs is not known" in answered(op=op)["reason"]
        assert answered(op="status")["status"]["engine"] == "silent"
        rig.until(lambda: rig.engine.is_connected)
        rig.engine.answer = full_answer
        assert rig.call(op="stop")["ok"]


def test_a_stop_that_an_engine_has_not_begun_to_read_is_answered_and_waits_for_it() -> None:
    rig = GatewayRig()
    try:
        rig.gateway.step(0)
        rig.control.send(b'{"op":"stop","id":2}')
        for _ in range(PATIENCE):
            rig.gateway.step(5)
            if rig.control.poll(0):
                break
            rig.clock.t_ns += ANSWERED_WITHIN_NS // 10
        reply = rig.reply()
        assert reply["error"] == "engine_gone"
        assert "the stop waits for it" in reply["reason"]
        rig.until(lambda: bool(rig.engine.heard))
        assert isinstance(rig.engine.heard[0], StopNow)
    finally:
        rig.__exit__(None, None, None)


@pytest.mark.parametrize("op", ["arm", "stop", "frame"])
def test_what_is_asked_in_the_turn_in_which_the_engine_ends_is_told_that_it_is_gone(
    op: str,
) -> None:
    # By hand: what is sent has arrived when the sending returns.
    with GatewayRig() as rig, connected(rig.folder / "control.sock") as client:
        client.send(hello("DEALER"))
        lease = rig.open()
        rig.engine.hang_up()
        frame = {"lease": lease, "seq": 1, "level": [0] * 4} if op == "frame" else {}
        client.send(part(json.dumps({"op": op, **frame}).encode()))

        rig.gateway.step(0)  # the link's end has not been read yet

        reply = client.recv(4_096)
        assert b'"error":"engine_gone"' in reply
        assert b"nothing is stimulated" in reply


def test_when_the_engine_ends_everybody_is_told_at_once() -> None:
    with GatewayRig() as rig:
        socket = subscribe(rig)
        lease = rig.open()
        rig.engine.answer = lambda _: None
        rig.control.send(b'{"op":"arm","id":1}')
        rig.until(lambda: len(rig.engine.heard) == 2)

        rig.engine.close()

        assert heard(rig, socket, "state")["engine"] == "gone"
        reply = rig.reply()
        assert (reply["id"], reply["error"]) == (1, "engine_gone")
        for request in (
            {"op": "hello"},
            {"op": "keep", "lease": lease},
            {"op": "arm"},
            {"op": "frame", "lease": lease, "seq": 1, "level": [0] * 4},
        ):
            assert rig.call(**request)["error"] == "engine_gone"
        status = rig.call(op="status")["status"]
        assert (status["state"], status["engine"]) == ("SAFE", "gone")


def test_a_stop_without_an_engine_is_answered_with_what_that_means_for_the_skin() -> None:
    with GatewayRig() as rig:
        rig.engine.close()
        rig.until(lambda: rig.call(op="status")["status"]["engine"] == "gone")

        reply = rig.call(op="stop")

        assert reply["error"] == "engine_gone"
        assert "nothing is stimulated" in reply["reason"]


def test_an_engine_that_comes_back_is_found_and_the_old_lease_is_not() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        rig.engine.close()
        rig.until(lambda: rig.call(op="status")["status"]["engine"] == "gone")
        rig.engine = ScriptedEngine(rig.folder)
        rig.step(3)
        assert rig.call(op="status")["status"]["engine"] == "gone", "not looked for all the time"

        rig.clock.t_ns += 200_000_000

        rig.until(lambda: rig.call(op="status")["status"]["engine"] == "there")
        assert rig.call(op="keep", lease=lease)["error"] == "no_lease"


def test_reports_of_the_engine_reach_subscribers_with_all_counts_added() -> None:
    with GatewayRig() as rig:
        socket = subscribe(rig, "refused")
        rig.call(op="keep", lease="x")
        rig.ask(b"nonsense")

        rig.engine.report_state(refused_no_lease=4, begun=2)
        counters = heard(rig, socket, "state")["counters"]
        refused = RefusedReport(now_ns=1, error="expired", reason="old", count=3, seq=8)
        rig.engine.say(Report(refused=refused))

        assert counters["refused_no_lease"] == 5
        assert (counters["begun"], counters["malformed"]) == (2, 1)
        assert heard(rig, socket, "refused")["seq"] == 8


def test_bytes_that_are_no_message_of_the_engines_end_the_link() -> None:
    with GatewayRig() as rig:
        rig.engine.say("no message")  # type: ignore[arg-type]

        rig.until(lambda: rig.call(op="status")["status"]["engine"] == "gone")

        assert rig.counter("engine_unreadable") == 1


@pytest.mark.parametrize("rows", [b"abc", bytes(ROW_BYTES - 1), b"\xff" * ROW_BYTES])
def test_pulses_that_are_none_end_the_link_and_neither_the_gateway_nor_its_record(
    rows: bytes,
) -> None:
    with GatewayRig() as rig:
        assert rig.call(op="record", do="start", name="p01")["ok"]
        rig.engine.say(PulseBatch(rows=rows))
        rig.until(lambda: not rig.engine.is_connected)
        rig.clock.t_ns += 1_000_000_000
        rig.until(lambda: rig.call(op="status")["status"]["engine"] == "there")
        assert rig.counter("engine_unreadable") == 1
        assert rig.call(op="note", text="still written")["ok"]
