"""Records by their requests: who may do what, what is told when one cannot be written, and that
nothing else changes then.
"""

from __future__ import annotations

import base64
import json
import os
import resource
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import pytest
import zmq

from etd.files.paths import FRAMES
from etd.gateway.allowance import BYTES_A_SECOND, MOST_BYTES
from etd.gateway.config import Operators
from etd.gateway.engine_link import EngineLink
from etd.gateway.inbound import InboundMessage
from etd.gateway.last_frames import LastFrames
from etd.gateway.lease import LeaseView
from etd.gateway.pending import PendingRequests
from etd.gateway.record_file import RESERVE_BYTES, Disk, RecordFile
from etd.gateway.record_store import RecordStore
from etd.gateway.recorder import Recorder
from etd.gateway.records import CLOSED_NS, RecordHandler
from etd.protocol.carried import CarriedOver, RampState, SoftStartState
from etd.protocol.errors import Refused
from etd.protocol.link import (
    Answer,
    Command,
    NewFrame,
    PulseBatch,
    RecordBegins,
    RecordPulses,
    Report,
)
from etd.protocol.messages import Halt, Note, Record, StateReport
from etd.protocol.pulse_row import OWN, SAME
from gateway_rig import GatewayRig, HandClock
from scripted_engine import full_answer

PULSE = SAME.pack(2, 0, 0, -1, 2_000, 1_998, 0, 99.33, 199_800) + OWN.pack(
    *(5, 4, 7, 0, 3, 1_500, 40_000), *(0.0, 40.0, 60.0, 0.0, 0.0, 0.0)
)
CARRIED = CarriedOver(
    t_ns=1, state="ARMED", soft_start=SoftStartState(array=RampState()), shown_seq=7
)


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as rig:
        yield rig


def record(rig: GatewayRig, do: str, name: str | None = None, **more: Any) -> dict[str, Any]:
    request = {"op": "record", "do": do, **more}
    return rig.call(**request if name is None else {**request, "name": name})


def written(rig: GatewayRig, name: str) -> list[dict[str, Any]]:
    """The lines, as `get` answers them piece by piece."""
    data = b""
    while piece := base64.b64decode(record(rig, "get", name, offset=len(data))["data"]):
        data += piece
    assert data == (rig.state_dir / "records" / f"{name}.jsonl").read_bytes()
    return [json.loads(line) for line in data.splitlines()]


def written_bytes(rig: GatewayRig, name: str) -> bytes:
    return (rig.state_dir / "records" / f"{name}.jsonl").read_bytes()


def ended(rig: GatewayRig, name: str) -> list[dict[str, Any]]:
    assert record(rig, "stop")["ok"]
    return written(rig, name)


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


class Asking:
    """Users of one gateway, and who of them may operate."""

    def __init__(self, folder: Path, *operators: str, disk: Disk | None = None) -> None:
        self.clock = HandClock()
        self.store = RecordStore(folder, disk)
        self.recorder = Recorder(
            "d", self.store, LeaseView(), LastFrames(), lambda: (1, 2, 3), lambda _: True
        )
        self._handler = RecordHandler(
            self.store,
            self.recorder,
            EngineLink(folder, Counter()),
            PendingRequests(),
            self.clock,
            Operators(operators),
        )

    def ask(self, uid: int, do: str, name: str = "p01") -> object:
        request = Record(do=cast("Any", do), name=name)
        return self._handler.handle(request, InboundMessage(1, (), uid, b""))

    def note(self, uid: int, text: str = "a remark") -> None:
        self._handler.note(Note(text=text), InboundMessage(1, (), uid, b""))

    def why_no_note(self, uid: int) -> Refused | None:
        """Of a thousand characters."""
        try:
            self.note(uid, "x" * 1_000)
        except Refused as refused:
            return refused
        return None

    def wait_closed(self) -> None:
        self.recorder.wait_closed(60.0)
        self.recorder.look(self.clock.t_ns)

    def refused(self, uid: int, do: str) -> str:
        with pytest.raises(Refused) as caught:
            self.note(uid) if do == "note" else self.ask(uid, do)
        assert caught.value.code == "not_permitted"
        return caught.value.reason


STARTER, OTHER = 1235, 1234


@pytest.mark.parametrize("operators", [(), ("root",)], ids=["nobody named", "root named"])
def test_a_record_is_read_noted_ended_and_deleted_by_who_began_it_or_an_operator(
    tmp_path: Path, operators: tuple[str, ...]
) -> None:
    """It has a person's thresholds, and every pulse. Where no operator is named, all may arm; but a
    record is not everybody's for that.
    """
    users = Asking(tmp_path, *operators)
    users.ask(STARTER, "start")
    for do in ("get", "note", "stop", "delete"):
        assert "another user's" in users.refused(OTHER, do), do
    for uid in (STARTER, 0):
        users.ask(uid, "get")
        users.note(uid)
    with pytest.raises(Refused, match="being written"):
        users.ask(STARTER, "delete")
    users.ask(STARTER, "stop")
    users.wait_closed()
    for do in ("get", "delete"):
        assert "another user's" in users.refused(OTHER, do), do
    users.ask(STARTER, "get")
    users.ask(STARTER, "delete")
    users.ask(STARTER, "start", "p02")
    users.ask(0, "stop", "p02")
    users.wait_closed()
    users.ask(0, "delete", "p02")
    assert users.store.facts(None) == ()


def test_a_named_operator_may_too_and_the_gateways_own_user(tmp_path: Path) -> None:
    users = Asking(tmp_path, "1500")
    users.ask(STARTER, "start")
    for uid in (1500, os.geteuid()):
        users.ask(uid, "get")
        users.note(uid)


def test_a_record_that_does_not_say_whose_it_is_is_an_operators(tmp_path: Path) -> None:
    users = Asking(tmp_path, "1500")
    users.ask(STARTER, "start", "p02")
    for number, content in enumerate(
        (b"", b"no JSON\n", b'{"kind":"end","t_ns":1,"why":"full"}\n')
    ):
        (tmp_path / "records" / f"torn-{number}.jsonl").write_bytes(content)
        with pytest.raises(Refused, match="another user's"):
            users.ask(STARTER, "get", f"torn-{number}")
        users.ask(1500, "get", f"torn-{number}")


def test_where_no_folder_can_be_a_record_is_refused_and_all_else_goes_on(rig: GatewayRig) -> None:
    rig.state_dir.mkdir(parents=True)
    (rig.state_dir / "records").write_text("in the way")
    refused = record(rig, "start", "p01")
    assert refused["error"] == "record_failed"
    assert "cannot be a folder" in refused["reason"]
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


# --- the disk -------------------------------------------------------------------------------------


class SmallDisk(Disk):
    """With so much room as a test says."""

    def __init__(self) -> None:
        self.left_bytes = RESERVE_BYTES

    def free_bytes(self, _: Path) -> int:
        return self.left_bytes


def test_a_record_leaves_room_for_what_else_is_on_the_disk() -> None:
    """Without room for the note of the supply, nothing could be armed."""
    disk = SmallDisk()
    with GatewayRig(disk=disk) as rig:
        assert record(rig, "start", "p01")["ok"]
        disk.left_bytes = RESERVE_BYTES - 1
        rig.until(lambda: rig.call(op="status")["status"]["record"] is None)
        assert "256 MiB are free" in rig.call(op="status")["status"]["record_problem"]
        rig.until(lambda: b'"end"' in written_bytes(rig, "p01"))
        end = json.loads(written_bytes(rig, "p01").splitlines()[-1])
        assert end["why"] == "full"
        assert "256 MiB" in end["detail"]
        rig.until(lambda: record(rig, "start", "p02")["error"] == "record_failed")
        refused = record(rig, "start", "p02")
        assert "make room" in refused["reason"]
        disk.left_bytes = RESERVE_BYTES
        assert record(rig, "start", "p02")["ok"]


def test_what_is_free_is_what_the_system_says(tmp_path: Path) -> None:
    found = os.statvfs(tmp_path)
    told = Disk().free_bytes(tmp_path)
    assert told == pytest.approx(found.f_bavail * found.f_frsize, rel=0.2)


def test_a_user_adds_so_much_to_a_record_and_then_so_much_a_second(tmp_path: Path) -> None:
    users = Asking(tmp_path, "1500")
    users.ask(STARTER, "start")

    def add_all(uid: int) -> int:
        count = 0
        while (refused := users.why_no_note(uid)) is None:
            count += 1
        assert refused.code == "busy"
        assert "16 KiB more each second" in refused.reason
        return count

    at_once = add_all(STARTER)
    assert at_once * 1_000 < MOST_BYTES < (at_once + 1) * 1_200
    users.note(1500)  # another's allowance is not touched
    users.clock.t_ns += 10_000_000_000
    after = add_all(STARTER)
    assert after * 1_000 < 10 * BYTES_A_SECOND < (after + 1) * 1_200
    users.ask(STARTER, "stop")
    users.wait_closed()
    users.ask(STARTER, "start", "p02")
    assert add_all(STARTER) == at_once


def test_requests_of_others_fill_no_disk_and_the_holders_are_all_there(rig: GatewayRig) -> None:
    record(rig, "start", "p01")
    stranger = json.dumps({"op": "frame", "lease": "x", "seq": 1, "level": [0.123456789] * 256})
    sent = 0
    while sent <= 1.3 * MOST_BYTES:
        assert not rig.ask(stranger)["ok"]
        sent += len(stranger)
    lease = rig.open()
    for seq in range(1, 4):
        assert rig.call(op="frame", lease=lease, seq=seq, current_ua=[100] * 4)["ok"]
    assert not rig.call(op="frame", lease=lease, seq=1, current_ua=[100] * 4)["ok"]
    lines = ended(rig, "p01")
    assert sum(map(len, written_bytes(rig, "p01").splitlines())) < 2 * MOST_BYTES
    asked = [line for line in lines if line["kind"] == "request"]
    frames = [line for line in asked if line["request"]["op"] == "frame"]
    strangers = [line for line in frames if "level" in line["request"]]
    assert [line["request"]["seq"] for line in frames[len(strangers) :]] == [1, 2, 3, 1]
    assert {line["client"] for line in strangers} == {""}
    (lost,) = (line for line in lines if line["kind"] == "lost")
    assert lost["requests"] > 0
    assert "lines" not in lost


def test_a_stranger_pushes_no_frame_out_of_what_a_record_begins_with(rig: GatewayRig) -> None:
    lease = rig.open()
    assert rig.call(op="frame", lease=lease, seq=7, current_ua=[100, 0, 0, 0])["ok"]
    preview = rig.call(op="frame", lease=lease, seq=8, current_ua=[9] * 4, preview=True)
    assert preview["ok"]
    for seq in range(300):
        stranger = {"lease": "another", "seq": seq, "current_ua": [1] * 4}
        assert rig.call(op="frame", **stranger)["error"] == "other_lease"
    record(rig, "start", "p01")
    rig.until(lambda: RecordPulses(is_on=True) in rig.engine.heard)
    rig.engine.say(RecordBegins(carried=CARRIED))
    rig.step(3)
    (carried,) = (line for line in ended(rig, "p01") if line["kind"] == "carried")
    assert carried["frames"] == [{"op": "frame", "seq": 7, "current_ua": [100, 0, 0, 0]}]
