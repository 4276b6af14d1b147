"""The daemon's processes stopped for seconds, on the fake: nothing is shown late, and no fault."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq

import trace_decoder
import trace_rules
from command_rig import WITHIN_S, CommandRig, command_rig
from etd.client import Display, clock
from etd.files.paths import CONTROL, FRAMES, address_of
from etd.protocol.errors import Refused
from etd.protocol.messages import StateReport
from etd_hal.boardfile import load_board
from stepped_board import BOARDS

pytestmark = pytest.mark.slow

#: It has a heartbeat, a rail monitor and both stops: all that a stall could be taken for.
BOARD = "reference-hv507"
STOPPED_S = 5.0


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def pulses(trace: Path) -> int:
    return trace.read_bytes().count(b'"bus": "body"')


def state_and_halt(reply: dict[str, object]) -> tuple[object, object]:
    status = reply["status"]
    assert isinstance(status, dict)
    return status["state"], status["halt"]


def wait_for(display: Display, state: str) -> StateReport:
    deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
    while (report := display.status()).state != state:
        assert clock.now_ns() < deadline_ns, f"never {state}: {report}"
    return report


def test_a_stopped_engine_shows_nothing_afterwards_and_can_be_armed_again(rig: CommandRig) -> None:
    trace = rig.folder / "trace.jsonl"
    frame = [1_000] * 16
    options = ("--board", f"fake:{BOARD}", "--array", "grid-4x4", "--trace", str(trace))
    with rig.daemon(*options) as daemon:
        engine = daemon.children()["engine"]
        address = address_of(rig.folder / "run" / "etd" / "main")
        with Display(address=address, max_current_ua=1_000, width_us=100) as display:
            display.arm(WITHIN_S)
            while pulses(trace) < 100:
                display.show_current(frame, ttl_ms=1_000)
            os.kill(engine, signal.SIGSTOP)
            try:
                shown = pulses(trace)
                clock.sleep_s(STOPPED_S)
            finally:
                os.kill(engine, signal.SIGCONT)
            report = wait_for(display, "SAFE")
            assert (report.last_disarm, report.halt) == ("lapsed", None)
            assert report.clock_lag_us >= (STOPPED_S - 1.0) * 1e6
            assert pulses(trace) - shown <= 1, "at most the one under way"
            with pytest.raises(Refused):
                display.show_current(frame)
        with Display(address=address, max_current_ua=1_000, width_us=100) as display:
            display.arm(WITHIN_S)
    records = trace_decoder.read(trace)
    assert trace_rules.violations(records, load_board(BOARDS / f"{BOARD}.toml").rest_us) == []


@pytest.mark.parametrize("parts", [("engine",), ("gateway",), ("engine", "gateway")], ids="+".join)
def test_a_frame_sent_while_the_daemon_stood_still_is_never_shown(
    rig: CommandRig, parts: tuple[str, ...]
) -> None:
    """Whatever its client says of when it was sent: the longest ttl there is, and no stamp."""
    trace = rig.folder / "trace.jsonl"
    sockets = rig.folder / "run" / "etd" / "main"
    options = ("--board", f"fake:{BOARD}", "--array", "pad-8", "--trace", str(trace))
    with rig.daemon(*options) as daemon, zmq.Context() as context:
        children = daemon.children()
        control, frames = context.socket(zmq.DEALER), context.socket(zmq.PUSH)
        with control, frames:
            for client, name in ((control, CONTROL), (frames, FRAMES)):
                client.setsockopt(zmq.LINGER, 0)
                client.connect(f"ipc://{sockets / name}")

            old: list[dict[str, object]] = []

            def ask(**request: object) -> dict[str, object]:
                control.send_json(request)
                while True:
                    assert control.poll(int(WITHIN_S * 1e3)), f"no answer to {request}"
                    answer = dict(json.loads(control.recv()))
                    if answer["id"] == request.get("id"):
                        return answer
                    old.append(answer)

            limits = {"max_current_ua": 1_000, "width_us": 100}
            held = ask(op="open", client="still", limits=limits)["lease"]
            assert ask(op="arm")["ok"]
            seq = 0
            while pulses(trace) < 100:
                seq += 1
                frame = {"op": "frame", "lease": held, "seq": seq, "current_ua": [1_000] * 8}
                assert ask(**frame)["ok"]
            try:
                for part in parts:
                    os.kill(children[part], signal.SIGSTOP)
                # What was shown before lasts for its own ttl, where the gateway alone stands still.
                clock.sleep_s(0.5)
                shown = pulses(trace)
                for _ in range(5):
                    seq += 2
                    sent = {**frame, "ttl_ms": 1_000, "id": "old"}
                    control.send_json({**sent, "seq": seq})
                    frames.send_json({**sent, "seq": seq + 1})
                    clock.sleep_s(STOPPED_S / 5)
            finally:
                for part in parts:
                    os.kill(children[part], signal.SIGCONT)
            # Answered after all of them, and not until the engine has judged them.
            while len(old) < 5:
                ask(op="status", id="now")
            clock.sleep_s(0.5)
            assert [answer["ok"] for answer in old] == [False] * 5
            assert pulses(trace) - shown <= (0 if parts == ("gateway",) else 1)
            # The engine's report of its state comes after its answers.
            deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
            while (found := state_and_halt(ask(op="status", id="now")))[0] != "SAFE":
                assert clock.now_ns() < deadline_ns, found
            assert found == ("SAFE", None)
