"""Records by their requests: who may do what, what is told when one cannot be written, and that
nothing else changes then.
"""

from __future__ import annotations

import json
import os
import resource
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zmq

from etd.files.paths import FRAMES
from etd.gateway.record_file import Disk, RecordFile
from etd.gateway.records import CLOSED_NS
from etd.protocol.link import (
    Answer,
    Command,
    NewFrame,
    PulseBatch,
    RecordPulses,
    Report,
)
from etd.protocol.messages import Halt, StateReport
from etd.protocol.pulse_row import OWN, SAME
from gateway_rig import GatewayRig
from record_requests import ended, record, written_bytes
from scripted_engine import full_answer

PULSE = SAME.pack(2, 0, 0, -1, 2_000, 1_998, 0, 99.33, 199_800) + OWN.pack(
    *(5, 4, 7, 0, 3, 1_500, 40_000), *(0.0, 40.0, 60.0, 0.0, 0.0, 0.0)
)


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as rig:
        yield rig


def kinds(lines: list[dict[str, Any]]) -> list[str]:
    return [line["kind"] for line in lines]


def test_a_record_begins_with_what_it_is_and_ends_with_why(rig: GatewayRig) -> None:
    assert record(rig, "start", "p01")["ok"]
    assert rig.call(op="status")["status"]["record"] == "p01"
    lines = ended(rig, "p01")
    assert kinds(lines) == ["header", "clocks", "engine", "state", "end"]
    header, clocks, engine, state, end = lines
    assert (header["name"], header["daemon"], header["uid"]) == ("p01", "rig", os.getuid())
    assert clocks["wall_ns"] > clocks["t_ns"]
    assert engine["facts"]["body_site"] == "fingertip"
    assert state["report"]["state"] == "SAFE"
    assert end["why"] == "stopped"
    assert rig.call(op="status")["status"]["record"] is None
    (facts,) = record(rig, "list")["records"]
    assert facts["name"] == "p01"
    assert not facts["is_running"]


def test_requests_are_there_with_their_replies_and_without_the_lease(rig: GatewayRig) -> None:
    record(rig, "start", "p01")
    lease = rig.open()
    rig.call(op="frame", lease=lease, seq=1, current_ua=[100, 0, 0, 0], ttl_ms=300)
    rig.call(op="frame", lease=lease, seq=1, current_ua=[100, 0, 0, 0])
    rig.call(op="note", text="a remark")
    rig.call(op="status")
    lines = ended(rig, "p01")
    asked = [line for line in lines if line["kind"] == "request"]
    replies = {line["number"]: line for line in lines if line["kind"] == "reply"}
    assert [line["request"]["op"] for line in asked] == ["open", "frame", "frame"]
    assert asked[1]["request"] == {
        "op": "frame",
        "seq": 1,
        "current_ua": [100, 0, 0, 0],
        "ttl_ms": 300,
    }
    assert [replies[line["number"]]["ok"] for line in asked] == [True, True, False]
    assert replies[asked[2]["number"]]["reply"]["error"] == "old_seq"
    (granted,) = (line for line in lines if line["kind"] == "lease")
    assert granted["limits"] == {"max_current_ua": 3000, "width_us": 100}
    assert [line["text"] for line in lines if line["kind"] == "note"] == ["a remark"]
    assert lease not in json.dumps(lines)


def test_a_record_knows_from_its_beginning_how_far_the_boards_clock_lags(rig: GatewayRig) -> None:
    lag_us = 5_000_000
    state = StateReport(state="SAFE", now_ns=7, engine="there", clock_lag_us=lag_us)
    rig.engine.say(Report(state=state))
    rig.until(lambda: rig.call(op="status")["status"]["clock_lag_us"] == lag_us)
    record(rig, "start", "p01")
    rig.call(op="note", text="a remark")
    lines = ended(rig, "p01")
    (clocks,) = (line for line in lines if line["kind"] == "clocks")
    (note,) = (line for line in lines if line["kind"] == "note")
    assert clocks["clock_lag_us"] == lag_us
    assert note["t_ns"] == rig.clock.t_ns - lag_us * 1_000


def test_streamed_frames_are_there_with_who_sent_them(rig: GatewayRig) -> None:
    record(rig, "start", "p01")
    lease = rig.open()
    frames = rig.socket(zmq.PUSH, FRAMES)
    frames.send_json({"op": "frame", "lease": lease, "seq": 4, "current_ua": [1, 2, 3, 4]})
    rig.until(lambda: any(isinstance(it, NewFrame) for it in rig.engine.heard))
    frames.send_json({"op": "frame", "lease": lease, "seq": 3, "current_ua": [1, 2, 3, 4]})
    rig.until(lambda: bool(rig.counter("refused_old_seq")))
    frames.close()
    lines = ended(rig, "p01")
    (streamed,) = (line for line in lines if line["kind"] == "request" and not line["number"])
    assert streamed["request"]["seq"] == 4
    assert (streamed["client"], streamed["uid"]) == ("test", os.getuid())
    (refused,) = (line["report"] for line in lines if line["kind"] == "refused")
    assert refused["error"] == "old_seq"


def test_pulses_that_come_before_the_answer_to_stop_are_in_the_record(rig: GatewayRig) -> None:
    """The engine is asked to tell what it has gathered, and what it has lost."""

    def answer(message: Command | NewFrame) -> Answer:
        if isinstance(message, RecordPulses) and not message.is_on:
            rig.engine.say(PulseBatch(rows=2 * PULSE, lost=7))
        return full_answer(message)

    rig.engine.answer = answer
    record(rig, "start", "p01")
    rig.until(lambda: RecordPulses(is_on=True) in rig.engine.heard)
    lines = ended(rig, "p01")
    columns = lines[0]["columns"]
    (pulses,) = (line["rows"] for line in lines if line["kind"] == "pulses")
    assert len(pulses) == 2
    row = dict(zip(columns, pulses[0], strict=True))
    assert row == {
        "t_ns": 5,
        "asked_ns": 4,
        "electrode": 2,
        "purpose": "stimulus",
        "seq": 7,
        "polarity": "anodic",
        "wanted_ua": 2_000,
        "current_ua": 1_998,
        "prepulse_ua": 0,
        "width_us": 99.33,
        "charge_nc": 199.8,
        "delivered_ua": 1_500,
        "resistance_ohm": 40_000,
        "contact": "closed",
        "limited": None,
        "limited_by": None,
        "samples_v": [0.0, 40.0, 60.0],
    }
    (lost,) = (line for line in lines if line["kind"] == "lost")
    assert lost["pulses"] == 7


class Stops:
    """Requests to stop a record, and the engine's answers to them, held back."""

    def __init__(self, rig: GatewayRig) -> None:
        self.rig = rig
        self.refs: list[int] = []
        self.socket = rig.socket(zmq.DEALER, "control.sock")
        rig.engine.answer = self._answer

    def _answer(self, message: Command | NewFrame) -> Answer | None:
        if isinstance(message, RecordPulses) and not message.is_on and message.ref:
            self.refs.append(message.ref)
            return None
        return full_answer(message)

    def send(self, **request: str) -> None:
        self.socket.send(json.dumps(request).encode())

    def begin(self, name: str, count: int) -> None:
        """The record, and so many requests to stop it."""
        del self.refs[:]
        assert record(self.rig, "start", name)["ok"]
        self.rig.until(lambda: self.told == [True])
        for _ in range(count):
            self.send(op="record", do="stop")
        self.rig.until(lambda: len(self.refs) == count)

    @property
    def told(self) -> list[bool]:
        """The last that the engine was told of pulses."""
        told = [one.is_on for one in self.rig.engine.heard if isinstance(one, RecordPulses)]
        return told[-1:]

    @property
    def running(self) -> str | None:
        name: str | None = self.rig.call(op="status")["status"]["record"]
        return name


def test_a_stop_that_still_waits_ends_no_record_that_was_begun_since(rig: GatewayRig) -> None:
    """Perhaps another user's."""
    stops = Stops(rig)
    stops.begin("p01", 2)
    rig.engine.say(Answer(ref=stops.refs[0]))
    rig.until(lambda: bool(stops.socket.poll(0)))
    assert record(rig, "start", "p02")["ok"]
    rig.engine.say(Answer(ref=stops.refs[1]))
    stops.socket.recv_multipart()
    rig.until(lambda: bool(stops.socket.poll(0)))
    assert stops.running == "p02"


def test_the_engine_is_asked_again_after_it_was_replaced(rig: GatewayRig) -> None:
    record(rig, "start", "p01")
    rig.until(lambda: rig.engine.heard.count(RecordPulses(is_on=True)) == 1)
    rig.engine.hang_up()
    rig.step(2)
    rig.clock.t_ns += 1_000_000_000  # a gateway tries to connect now and then
    rig.until(lambda: rig.engine.heard.count(RecordPulses(is_on=True)) == 2)
    rig.until(lambda: rig.call(op="status")["status"]["engine"] == "there")
    lines = ended(rig, "p01")
    assert kinds(lines).count("engine") == 2
    assert "engine_gone" in kinds(lines)


def test_one_record_at_a_time_and_no_name_twice(rig: GatewayRig) -> None:
    record(rig, "start", "p01")
    assert record(rig, "start", "p02")["error"] == "wrong_state"
    ended(rig, "p01")
    again = record(rig, "start", "p01")
    assert again["error"] == "record_failed"
    assert "already" in again["reason"]
    assert record(rig, "start")["error"] == "bad_message"
    assert record(rig, "start", "../p")["error"] == "bad_message"


def test_without_a_record_a_note_and_a_stop_are_refused(rig: GatewayRig) -> None:
    note = rig.call(op="note", text="lost otherwise")
    assert note["error"] == "no_record"
    assert "etd record start" in note["reason"]
    assert record(rig, "stop")["error"] == "no_record"
    assert record(rig, "get", "none")["error"] == "not_found"


def test_where_no_folder_can_be_a_record_is_refused_and_all_else_goes_on(rig: GatewayRig) -> None:
    rig.state_dir.mkdir(parents=True)
    (rig.state_dir / "records").write_text("in the way")
    refused = record(rig, "start", "p01")
    assert refused["error"] == "record_failed"
    assert "this is no folder" in refused["reason"]
    assert rig.open()


@contextmanager
def small_files(most_bytes: int) -> Iterator[None]:
    """The kernel refuses what would be written past this, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_fails_ends_the_record_and_is_told_and_nothing_else_ends(
    rig: GatewayRig,
) -> None:
    with small_files(4_000):
        record(rig, "start", "p01")
        lease = rig.open()
        seq = 0

        def is_told() -> bool:
            nonlocal seq
            seq += 1
            answer = rig.call(op="frame", lease=lease, seq=seq, current_ua=[1] * 4)
            assert answer["ok"]
            return rig.call(op="status")["status"]["record_problem"] is not None

        rig.until(is_told)
    status = rig.call(op="status")["status"]
    assert "File too large" in status["record_problem"]
    assert "p01" in status["record_problem"]
    assert status["record"] is None
    assert record(rig, "stop")["error"] == "no_record"
    assert rig.call(op="keep", lease=lease)["ok"]
    # What was written before can be read.
    data = (rig.state_dir / "records" / "p01.jsonl").read_bytes()
    assert json.loads(data.splitlines()[0])["kind"] == "header"


def test_a_record_at_its_bound_ends_with_the_reason(tmp_path: Path) -> None:
    file = RecordFile(tmp_path / "r.jsonl", Disk(), most_bytes=100)
    assert file.put(b"x" * 60)
    assert not file.put(b"x" * 60)
    assert file.put(b"the end", is_last=True)
    file.close()
    file.wait_closed(60.0)
    assert (tmp_path / "r.jsonl").read_bytes() == b"x" * 60 + b"the end"


class SlowDisk(Disk):
    """Takes nothing until it is let go on."""

    def __init__(self) -> None:
        self.goes_on = threading.Event()
        self.is_asked = threading.Event()

    def write(self, fd: int, data: bytes) -> int:
        self.is_asked.set()
        assert self.goes_on.wait(60)
        return os.write(fd, data)


@pytest.fixture
def disk() -> Iterator[SlowDisk]:
    disk = SlowDisk()
    yield disk
    disk.goes_on.set()


def test_while_a_slow_disk_takes_the_end_of_a_record_all_others_are_served(disk: SlowDisk) -> None:
    with GatewayRig(disk=disk) as rig:
        record(rig, "start", "p01")
        assert disk.is_asked.wait(60)
        rig.control.send_json({"op": "record", "do": "stop", "id": 1})
        rig.step(10)
        for _ in range(3):
            rig.control.send_json({"op": "status", "id": 2})
            status = rig.reply()
            assert (status["id"], status["status"]["record"]) == (2, None)
        assert rig.call(op="stop")["ok"]
        refused = record(rig, "start", "p02")
        assert refused["error"] == "wrong_state"
        assert "p01" in refused["reason"]
        assert record(rig, "delete", "p01")["error"] == "wrong_state"
        disk.goes_on.set()
        stopped = rig.reply()
        assert (stopped["id"], stopped["problem"]) == (1, None)
        assert json.loads(written_bytes(rig, "p01").splitlines()[-1])["why"] == "stopped"
        assert record(rig, "start", "p02")["ok"]


def test_a_disk_that_takes_nothing_is_told_in_the_answer_to_the_stop(disk: SlowDisk) -> None:
    with GatewayRig(disk=disk) as rig:
        record(rig, "start", "p01")
        rig.control.send_json({"op": "record", "do": "stop"})
        rig.step(20)
        assert not rig.control.poll(0)
        rig.clock.t_ns += CLOSED_NS
        stopped = rig.reply()
        assert stopped["ok"]
        assert "disk is slow" in stopped["problem"]
        assert "p01" in stopped["problem"]
        disk.goes_on.set()


def test_a_file_is_closed_without_waiting_for_the_disk(disk: SlowDisk, tmp_path: Path) -> None:
    file = RecordFile(tmp_path / "r.jsonl", disk, most_bytes=100)
    assert file.put(b"x" * 60)
    assert disk.is_asked.wait(60)
    file.put(b"the end", is_last=True)
    file.close()
    assert not file.is_closed
    disk.goes_on.set()
    file.wait_closed(60.0)
    assert file.is_closed
    assert (tmp_path / "r.jsonl").read_bytes() == b"x" * 60 + b"the end"


def test_a_halt_is_there_at_once(rig: GatewayRig) -> None:
    record(rig, "start", "p01")
    halt = Halt(cause="fault", source="rail", detail="90 V", t_ns=3)
    rig.engine.say(Report(halt=halt))
    rig.step(3)
    lines = ended(rig, "p01")
    (told,) = (line["report"] for line in lines if line["kind"] == "halt")
    assert told == {"cause": "fault", "source": "rail", "detail": "90 V", "t_ns": 3}


def test_a_gateway_that_is_asked_to_end_ends_its_record() -> None:
    with GatewayRig() as rig:
        record(rig, "start", "p01")
        rig.gateway.close()
        data = (rig.state_dir / "records" / "p01.jsonl").read_bytes()
    assert json.loads(data.splitlines()[-1])["why"] == "ended"
