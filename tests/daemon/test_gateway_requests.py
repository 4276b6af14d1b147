"""Each op, from the socket to the engine and back.

Owns: what is passed on, what is answered, and who may ask.
"""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zmq

from etd.files.calibration_folder import MOST_FILE_BYTES, CalibrationFolder
from etd.gateway.config import GatewayConfig
from etd.gateway.pending import BOUNDS
from etd.gateway.server import Gateway
from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import digest_of
from etd.protocol.errors import AlreadyRunning, FileError
from etd.protocol.link import (
    Answer,
    ArmBoard,
    ClearHalt,
    CloseLease,
    Command,
    DisarmBoard,
    KeepLease,
    LeaseEnded,
    MeasureContact,
    NewFrame,
    SetMark,
)
from etd.protocol.messages import Halt
from etd.protocol.outcome import Clamp
from gateway_rig import GatewayRig, HandClock
from scripted_engine import engine_hello

CALIBRATION: dict[str, Any] = {
    "participant": "P01",
    "body_site": "fingertip",
    "array": "row-4",
    "polarity": "anodic",
    "width_us": 100,
    "rate_hz": 60,
    "returns": "all",
    "date": "2024-05-01",
    "program": "test",
    "electrode": [{"threshold_ua": 900, "comfortable_ua": 1800, "cap_ua": 2500}] * 4,
}


def keep(rig: GatewayRig, name: str) -> Calibration:
    """As the operator's own process stores it."""
    made = msgspec.convert(CALIBRATION, Calibration, strict=False)
    CalibrationFolder(rig.state_dir / "calibrations", None).put(name, made)
    return made


def test_hello_tells_the_facts_and_the_other_endpoints() -> None:
    with GatewayRig(default_calibration="me") as rig:
        reply = rig.call(op="hello", id="h")

        assert (reply["id"], reply["protocol"], reply["name"]) == ("h", 1, "rig")
        assert reply["array"]["electrodes"] == 4
        assert reply["endpoints"]["frames"] == f"ipc://{rig.folder}/frames.sock"
        assert reply["now_ns"] == rig.clock.now_ns()
        assert reply["default_calibration"] == "me"


def test_a_request_socket_gets_its_empty_part_back() -> None:
    with GatewayRig() as rig:
        req = rig.socket(zmq.REQ, "control.sock")
        req.send(b'{"op":"hello"}')
        assert rig.reply(req)["ok"]


def test_open_hands_out_a_token_that_only_the_engine_also_knows() -> None:
    with GatewayRig() as rig:
        reply = rig.call(op="open", client="a", limits={"max_current_ua": 900, "width_us": 50})

        (opened,) = rig.engine.leases
        assert len(reply["lease"]) == 32
        assert (opened.lease, opened.client) == (reply["lease"], "a")
        assert opened.limits is not None
        assert opened.limits.max_current_ua == 900


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({}, "limits_missing"),
        ({"limits": {"max_current_ua": 900}}, "bad_message"),
        ({"calibration": "nobody"}, "not_found"),
        (
            {"calibration": "x", "limits": {"max_current_ua": 900, "width_us": 50}},
            "bad_message",
        ),
    ],
)
def test_open_without_one_clear_limit_is_refused(given: dict[str, Any], code: str) -> None:
    with GatewayRig() as rig:
        assert rig.call(op="open", client="a", **given)["error"] == code
        assert rig.engine.heard == []


@pytest.mark.parametrize(
    ("request_", "kind"),
    [
        ({"op": "keep"}, KeepLease),
        ({"op": "disarm"}, DisarmBoard),
        ({"op": "close"}, CloseLease),
        ({"op": "measure"}, MeasureContact),
        ({"op": "mark", "tag": 3}, SetMark),
        ({"op": "arm"}, ArmBoard),
        ({"op": "clear"}, ClearHalt),
    ],
)
def test_each_op_becomes_its_command_and_is_answered(
    request_: dict[str, Any], kind: type[Command]
) -> None:
    with GatewayRig() as rig:
        lease = {} if request_["op"] in ("arm", "clear") else {"lease": rig.open()}
        rig.engine.heard.clear()

        reply = rig.call(**request_, **lease, id=1)

        assert (reply["ok"], reply["id"]) == (True, 1)
        assert [type(command) for command in rig.engine.heard] == [kind]


def test_measure_and_mark_carry_what_the_engine_said() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        assert rig.call(op="measure", lease=lease)["contact"] == [True, True, False, None]
        assert rig.call(op="mark", lease=lease)["marked_ns"] == 42


def test_a_frame_comes_through_whole_and_its_clamps_come_back() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        clamp = Clamp(electrode=1, wanted_ua=900, allowed_ua=800, reason="cap", limited_by=1)
        rig.engine.answer = lambda command: Answer(
            ref=command.ref, rate_hz=50.0, calibrated_hz=60.0, clamped=(clamp,)
        )

        reply = rig.call(
            op="frame",
            lease=lease,
            seq=3,
            current_ua=[0, 900, 0, 0],
            returns={"ring_mm": 2.5},
            ttl_ms=300,
            strict=True,
            tag=8,
            sent_ns=5,
        )

        assert (reply["seq"], reply["rate_hz"], reply["calibrated_hz"]) == (3, 50.0, 60.0)
        assert reply["clamped"][0]["allowed_ua"] == 800
        (sent,) = rig.engine.frames
        assert sent.frame.current_ua == (0, 900, 0, 0)
        assert (sent.frame.ttl_ms, sent.frame.strict, sent.frame.tag) == (300, True, 8)


def test_a_refusal_of_the_engine_keeps_its_fields() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        rig.engine.answer = lambda command: Answer(
            ref=command.ref,
            error="too_fast",
            reason="does not fit",
            electrode=2,
            achievable_hz=31.5,
        )

        reply = rig.call(op="frame", lease=lease, seq=1, level=[1, 1, 1, 1])

        assert (reply["error"], reply["electrode"]) == ("too_fast", 2)
        assert reply["achievable_hz"] == 31.5


def test_a_lapsed_lease_is_no_lease() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        rig.engine.say(LeaseEnded(lease="another", reason="closed"))
        assert rig.call(op="keep", lease=lease)["ok"]

        rig.engine.say(LeaseEnded(lease=lease, reason="lapsed"))
        rig.step(2)

        assert rig.call(op="keep", lease=lease)["error"] == "no_lease"


def test_after_a_halt_whatever_needs_the_lease_is_told_of_the_halt() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        rig.engine.state = "HALTED"
        halt = Halt(cause="wearer_stop", source="wearer_stop", detail="it opened", t_ns=5)
        rig.engine.report_state(halt=halt)
        rig.engine.say(LeaseEnded(lease=lease, reason="halted"))
        rig.step(2)
        requests: list[dict[str, Any]] = [
            *({"op": op} for op in ("keep", "disarm", "measure", "mark")),
            {"op": "frame", "seq": 1, "level": [0] * 4},
        ]
        for request in requests:
            reply = rig.call(**request, lease=lease)
            assert reply["error"] == "halted"
            assert "it opened" in reply["reason"]


def test_accounts_of_the_last_lease_are_had_until_another_is_opened() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        rig.engine.state = "HALTED"
        halt = Halt(cause="wearer_stop", source="wearer_stop", detail="it opened", t_ns=5)
        rig.engine.report_state(halt=halt)
        rig.engine.say(LeaseEnded(lease=lease, reason="halted"))
        rig.step(2)
        assert rig.call(op="account", seq=1, lease=lease)["account"]["seq"] == 1
        assert rig.call(op="account", seq=1, lease="another")["error"] == "halted"
        rig.engine.state = "SAFE"
        rig.engine.report_state()
        rig.step(2)
        assert rig.call(op="account", seq=1, lease=lease)["account"]["seq"] == 1
        rig.open()
        assert rig.call(op="account", seq=1, lease=lease)["error"] == "other_lease"


def test_without_a_lease_nothing_that_needs_one_is_passed_on() -> None:
    with GatewayRig() as rig:
        for op in ("keep", "disarm", "close", "measure", "mark"):
            assert rig.call(op=op, lease="x")["error"] == "no_lease"
        assert rig.engine.heard == []


def test_too_many_requests_under_way_are_refused_and_a_stop_is_not() -> None:
    with GatewayRig() as rig:
        rig.engine.answer = lambda _: None
        most = BOUNDS["engine"].of_a_user
        for index in range(most + 1):
            rig.control.send(json.dumps({"op": "arm", "id": index}).encode())

        reply = rig.reply()
        rig.engine.answer = lambda command: Answer(ref=command.ref)

        assert (reply["id"], reply["error"]) == (most, "busy")
        assert rig.call(op="stop", id="s")["ok"]


def test_an_engine_that_never_answers_is_not_waited_for_for_ever() -> None:
    with GatewayRig() as rig:
        rig.engine.answer = lambda _: None
        rig.control.send(b'{"op":"arm","id":1}')
        rig.until(lambda: len(rig.engine.heard) == 1)
        rig.clock.t_ns += 15_000_000_000

        reply = rig.reply()

        assert (reply["id"], reply["error"]) == (1, "engine_gone")


def test_a_calibration_is_given_back_and_opened_by_name_and_digest() -> None:
    with GatewayRig() as rig:
        made = keep(rig, "p01")
        got = rig.call(op="calibration", do="get", name="p01")
        assert got["names"] == ["p01"]
        assert got["calibration"]["electrode"][0]["cap_ua"] == 2500

        told = {
            "name": "p01",
            "polarity": "anodic",
            "digest": digest_of(made),
            "unfelt": [],
        }
        assert rig.call(op="open", client="a", calibration="p01")["calibrations"] == [told]
        (opened,) = rig.engine.leases
        assert [(it.name, it.digest) for it in opened.calibrations] == [("p01", digest_of(made))]
        assert rig.call(op="arm")["calibrations"] == []


@pytest.mark.parametrize("do", ["set", "delete"])
def test_no_calibration_is_stored_or_deleted_over_the_wire(do: str) -> None:
    with GatewayRig() as rig:
        keep(rig, "p01")
        reply = rig.call(op="calibration", do=do, name="p01")
        assert (reply["error"], "give get, list" in reply["reason"]) == ("bad_message", True)
        assert "etd calibration import" in reply["reason"]
        reply = rig.call(op="calibration", do="get", name="p01", calibration=CALIBRATION)
        assert reply["error"] == "bad_message"
        assert rig.call(op="calibration", do="list")["names"] == ["p01"]


def test_a_calibration_with_another_digest_than_was_meant_is_not_opened() -> None:
    with GatewayRig() as rig:
        digest = digest_of(keep(rig, "p01"))
        asked = {"op": "open", "client": "a", "calibration": "p01"}
        reply = rig.call(**asked, digests=["0" * 64])
        assert (reply["error"], digest[:12] in reply["reason"]) == ("bad_calibration", True)
        assert rig.call(**asked, digests=[digest] * 2)["error"] == "bad_message"
        for wrong in (digest[:-1], digest.upper(), digest + "\n", 7):
            assert rig.call(**asked, digests=[wrong])["error"] == "bad_message"
        assert rig.engine.leases == []
        assert rig.call(**asked, digests=[digest])["ok"]


def test_who_opens_looks_at_its_own_calibration_whatever_else_is_in_the_folder() -> None:
    """To look at all files would take longer with each of them."""
    with GatewayRig() as rig:
        keep(rig, "p01")
        for number in range(1_000):
            (rig.state_dir / "calibrations" / f"q{number}.toml").touch()
        assert rig.call(op="open", client="a", calibration="p01")["ok"]
        assert len(rig.call(op="hello")["calibrations"]) == 1_000


def test_a_calibration_that_is_nested_too_deep_is_refused_and_the_gateway_goes_on() -> None:
    with GatewayRig() as rig:
        folder = rig.state_dir / "calibrations"
        folder.mkdir(parents=True)
        (folder / "deep.toml").write_text("x = " + "[" * 5_000, encoding="utf-8")
        for request in ({"op": "calibration", "do": "get", "name": "deep"},
                        {"op": "open", "client": "a", "calibration": "deep"}):  # fmt: skip
            assert rig.call(**request)["error"] == "bad_calibration"
        assert rig.call(op="calibration", do="list")["names"] == ["deep"]


@pytest.mark.parametrize("kind", ["link", "second name", "large"])
def test_what_the_engine_would_not_open_is_not_shown_either(tmp_path: Path, kind: str) -> None:
    with GatewayRig() as rig:
        keep(rig, "p01")
        folder = rig.state_dir / "calibrations"
        assert rig.call(op="calibration", do="get", name="p01")["ok"]
        content = (folder / "p01.toml").read_bytes()
        if kind == "link":
            (tmp_path / "elsewhere").write_bytes(content)
            (folder / "p02.toml").symlink_to(tmp_path / "elsewhere")
        elif kind == "second name":
            (folder / "p02.toml").hardlink_to(folder / "p01.toml")
        else:
            (folder / "p02.toml").write_bytes(content + b"#" * MOST_FILE_BYTES)
        shown = rig.call(op="calibration", do="get", name="p02")
        assert shown["error"] == "bad_calibration"
        assert "p02" in shown["reason"]
        assert rig.call(op="open", client="a", calibration="p02")["error"] == "bad_calibration"


def test_the_fakes_own_calibrations_are_offered_to_the_fake_only(tmp_path: Path) -> None:
    shipped = Path(__file__).parents[2] / "config" / "calibrations"
    with GatewayRig(shipped_calibrations=shipped) as rig:
        assert "fake-fingertip" in rig.call(op="hello")["calibrations"]
        assert rig.call(op="calibration", do="get", name="fake-fingertip")["ok"]
    with GatewayRig(engine_hello(backend="linux"), shipped_calibrations=shipped) as rig:
        assert rig.call(op="hello")["calibrations"] == []
        assert rig.call(op="open", client="a", calibration="fake-fingertip")["error"] == "not_found"


def test_a_second_daemon_of_the_name_is_refused_and_the_first_goes_on() -> None:
    with GatewayRig() as rig:
        with pytest.raises(AlreadyRunning, match="'rig' is already running"):
            Gateway(rig.config, rig.clock)
        assert rig.call(op="hello")["ok"]


def test_the_lock_is_the_owners_alone_also_where_it_was_not() -> None:
    """Whoever can open it can lock it, and keep the daemon from starting again."""
    with GatewayRig() as rig:
        lock = rig.folder / "gateway.lock"
        assert lock.stat().st_mode & 0o777 == 0o600
        lock.chmod(0o640)
        rig.gateway.close()
        rig.gateway = Gateway(rig.config, rig.clock)
        assert lock.stat().st_mode & 0o777 == 0o600


def test_a_name_is_free_again_after_its_daemon_was_killed_with_sockets_left_over() -> None:
    with GatewayRig() as rig:
        rig.gateway.close()
        (rig.folder / "control.sock").touch()
        rig.gateway = Gateway(rig.config, rig.clock)
        rig.engine.hang_up()
        assert rig.call(op="status")["ok"]


def test_the_sockets_are_for_the_group_and_nobody_else() -> None:
    with GatewayRig() as rig:
        for name in ("control.sock", "frames.sock", "telemetry.sock"):
            assert stat.S_IMODE((rig.folder / name).stat().st_mode) == 0o660
        assert os.umask(0o022) == 0o022, "the process's own mask is as before"


def test_a_runtime_folder_that_everybody_may_write_to_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    config = GatewayConfig(name="x", runtime_folder=tmp_path, state_dir=tmp_path)
    with pytest.raises(FileError, match="everybody may write"):
        Gateway(config, HandClock())


def test_two_frames_in_order_keep_their_refs_apart() -> None:
    with GatewayRig() as rig:
        lease = rig.open()
        held: list[NewFrame] = []

        def hold(command: Command | NewFrame) -> None:
            assert isinstance(command, NewFrame)
            held.append(command)

        rig.engine.answer = hold
        for seq in (1, 2):
            rig.control.send(
                json.dumps(
                    {"op": "frame", "id": seq, "lease": lease, "seq": seq, "level": [0] * 4}
                ).encode()
            )
        rig.until(lambda: len(held) == 2)
        for frame in reversed(held):
            rig.engine.say(Answer(ref=frame.ref, rate_hz=1.0))

        assert [rig.reply()["id"] for _ in range(2)] == [2, 1]
