"""Whose a record is, and how much of the disk it may take.

Owns: who reads, notes, ends and deletes one; what it leaves free; what each user may add.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from engine_parts import calibration
from etd.files.calibration_folder import CalibrationFolder
from etd.gateway.allowance import BYTES_A_SECOND, MOST_BYTES
from etd.gateway.config import Operators
from etd.gateway.engine_link import EngineLink
from etd.gateway.inbound import InboundMessage
from etd.gateway.last_frames import LastFrames
from etd.gateway.lease import LeaseView
from etd.gateway.pending import PendingRequests
from etd.gateway.record_file import RESERVE_BYTES, Disk
from etd.gateway.record_store import RecordStore
from etd.gateway.recorder import Recorder
from etd.gateway.records import RecordHandler
from etd.protocol.carried import CarriedOver, RampState, SoftStartState
from etd.protocol.errors import Refused
from etd.protocol.felt import FeltFacts
from etd.protocol.link import RecordBegins, RecordPulses, Report
from etd.protocol.messages import Note, Record, StateReport
from gateway_rig import GatewayRig, HandClock
from record_requests import ended, record, written_bytes

CARRIED = CarriedOver(
    t_ns=1, state="ARMED", soft_start=SoftStartState(array=RampState()), shown_seq=7
)


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as rig:
        yield rig


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


def use_up_an_allowance(rig: GatewayRig) -> None:
    """By requests without the lease, which are refused."""
    stranger = json.dumps({"op": "frame", "lease": "x", "seq": 1, "level": [0.123456789] * 256})
    sent = 0
    while sent <= 1.3 * MOST_BYTES:
        assert not rig.ask(stranger)["ok"]
        sent += len(stranger)


def test_what_was_left_out_is_told_where_the_disk_ends_the_record() -> None:
    disk = SmallDisk()
    with GatewayRig(disk=disk) as rig:
        record(rig, "start", "p01")
        use_up_an_allowance(rig)
        disk.left_bytes = RESERVE_BYTES - 1
        rig.until(lambda: b'"end"' in written_bytes(rig, "p01"))
        lost, end = map(json.loads, written_bytes(rig, "p01").splitlines()[-2:])
        assert (lost["kind"], end["why"]) == ("lost", "full")
        assert lost["requests"] > 0


def test_requests_of_others_fill_no_disk_and_the_holders_are_all_there(rig: GatewayRig) -> None:
    record(rig, "start", "p01")
    use_up_an_allowance(rig)
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


def test_replies_to_others_are_theirs_too(rig: GatewayRig) -> None:
    """One to `calibration get` is hundreds of times as long as the request."""
    made = calibration(256)
    CalibrationFolder(rig.state_dir / "calibrations", None).put("whole", made)
    record(rig, "start", "p01")
    for _ in range(60):
        assert rig.call(op="calibration", do="get", name="whole")["calibration"] is not None
    lines = ended(rig, "p01")
    assert 0.9 * MOST_BYTES < len(written_bytes(rig, "p01")) < 1.1 * MOST_BYTES
    (lost,) = (line for line in lines if line["kind"] == "lost")
    assert lost["requests"] > 0
    assert "lines" not in lost


def state_of(answers: int, **changes: Any) -> Report:
    facts = FeltFacts(
        answers=answers,
        said_ns=answers,
        answer="too_strong",
        electrodes=None,
        lowers_only=True,
        factors=(0.5,) * 256,
    )
    state = StateReport(state="ARMED", now_ns=answers, engine="there", felt=facts, **changes)
    return Report(state=state)


def test_what_any_user_can_have_the_engine_say_fills_no_disk_either(rig: GatewayRig) -> None:
    """A state for each answer without the lease. Where more has changed, it is there."""
    record(rig, "start", "p01")
    for answers in range(1, 1_500):
        rig.engine.say(state_of(answers))
        rig.step()
    rig.engine.say(state_of(1_500, not_granted=("something else",)))
    rig.step(3)
    lines = ended(rig, "p01")
    assert 0.9 * MOST_BYTES < len(written_bytes(rig, "p01")) < 1.1 * MOST_BYTES
    states = [line["report"] for line in lines if line["kind"] == "state"]
    assert states[-1]["not_granted"] == ["something else"]
    (lost,) = (line for line in lines if line["kind"] == "lost")
    assert lost["lines"] == 1_500 - len([one for one in states if one.get("felt")])


def test_a_record_begun_in_the_turn_in_which_another_ended_has_its_pulses(tmp_path: Path) -> None:
    """Who asked for the end had the engine turn them off, and no turn was over since."""
    turns: list[bool] = []

    def turn(is_on: bool) -> bool:
        turns.append(is_on)
        return True

    store = RecordStore(tmp_path, None)
    recorder = Recorder("d", store, LeaseView(), LastFrames(), lambda: (1, 2, 3), turn)
    recorder.start("p01", STARTER, None, None)
    recorder.look(1)
    recorder.stop("stopped", 2)
    recorder.wait_closed(60.0)
    recorder.start("p02", STARTER, None, None)
    recorder.look(3)
    assert turns == [True, True]


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
