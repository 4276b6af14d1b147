"""Calibrations that are read for clients: nobody waits for it but who has asked.

Owns: what is served meanwhile, whose turn it is, and what is kept of what was read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq
from msgspec.structs import replace

from etd.files import resources
from etd.files.calibration import load_calibration
from etd.gateway.parsed_files import MOST, ParsedFiles, seen
from etd.gateway.pending import BOUNDS
from etd.gateway.readings import READ_WITHIN_NS, CalibrationReadings
from etd.protocol.errors import Refused
from etd.protocol.link import Answer, StopNow
from gateway_rig import GatewayRig
from held_reader import HeldReader

pytestmark = pytest.mark.slow

SHIPPED = resources.find("calibrations", "fake-fingertip-pad-8")
READ = load_calibration(SHIPPED)
A_USER, ANOTHER = 1_234, 1_235


@pytest.fixture
def reader() -> HeldReader:
    return HeldReader()


@pytest.fixture
def rig(reader: HeldReader) -> Iterator[GatewayRig]:
    with GatewayRig(reader=reader) as made:
        folder = made.state_dir / "calibrations"
        folder.mkdir(parents=True)
        for name in ("P01", "P02"):
            (folder / f"{name}.toml").write_bytes(SHIPPED.read_bytes())
        yield made


def asked(rig: GatewayRig, **request: Any) -> zmq.Socket[bytes]:
    """A client of its own, whose request the gateway has taken."""
    client = rig.socket(zmq.DEALER, "control.sock")
    client.send(json.dumps(request).encode())
    rig.step(10)
    return client


def test_while_one_is_read_others_are_served_and_a_stop_is_sent(
    rig: GatewayRig, reader: HeldReader
) -> None:
    lease = rig.open()
    asker = asked(rig, op="calibration", do="get", name="P01")
    assert reader.begun == ["P01"]
    assert rig.call(op="keep", lease=lease)["ok"]
    assert rig.call(op="stop")["ok"]
    assert any(isinstance(command, StopNow) for command in rig.engine.heard)
    assert not asker.poll(0)
    reader.found = READ
    assert rig.reply(asker)["calibration"]["participant"] == READ.participant


def test_a_lease_is_opened_once_all_its_calibrations_were_read(
    rig: GatewayRig, reader: HeldReader
) -> None:
    opener = asked(rig, op="open", client="c", calibration=["P01", "P02"])
    reader.found = READ
    rig.step(5)
    assert reader.begun == ["P01", "P02"]
    assert not rig.engine.leases
    reader.found = replace(READ, polarity="cathodic")
    assert rig.reply(opener)["ok"]
    (lease,) = rig.engine.leases
    assert [wanted.name for wanted in lease.calibrations] == ["P01", "P02"]


def test_what_was_read_is_not_read_again_until_the_file_changes(
    rig: GatewayRig, reader: HeldReader
) -> None:
    for _ in range(2):
        reader.begun.clear()
        client = asked(rig, op="calibration", do="get", name="P01")
        reader.found = READ
        assert rig.reply(client)["ok"]
        assert rig.call(op="calibration", do="get", name="P01")["ok"]
        assert reader.begun == ["P01"]
        file = rig.state_dir / "calibrations" / "P01.toml"
        file.write_bytes(file.read_bytes() + b"\n")


def test_what_was_refused_is_read_again(rig: GatewayRig, reader: HeldReader) -> None:
    """The process may have been killed: that is no property of the file."""
    killed = Refused("bad_calibration", "it was killed")
    for found, error in ((killed, "bad_calibration"), (READ, None)):
        client = asked(rig, op="calibration", do="get", name="P01")
        reader.found = found
        assert rig.reply(client).get("error") == error
    assert reader.begun == ["P01", "P01"]


def test_what_another_one_has_had_read_is_answered_at_once(
    rig: GatewayRig, reader: HeldReader
) -> None:
    waiting = [asked(rig, op="calibration", do="get", name="P01") for _ in range(4)]
    reader.found = READ
    for client in waiting:
        assert rig.reply(client)["ok"]
    assert reader.begun == ["P01"]


def test_what_nobody_waits_for_any_more_is_not_read(rig: GatewayRig, reader: HeldReader) -> None:
    first, second = (asked(rig, op="calibration", do="get", name=name) for name in ("P01", "P02"))
    rig.clock.t_ns += 2 * READ_WITHIN_NS
    errors = {rig.reply(client)["error"] for client in (first, second)}
    assert errors <= {"engine_gone", "bad_calibration"}
    rig.step(5)
    assert reader.begun == ["P01"]


def test_a_file_that_is_written_while_it_is_read_is_asked_for_again(
    rig: GatewayRig, reader: HeldReader
) -> None:
    client = asked(rig, op="calibration", do="get", name="P01")
    file = rig.state_dir / "calibrations" / "P01.toml"
    file.write_bytes(file.read_bytes() + b"\n")
    reader.found = READ
    reply = rig.reply(client)
    assert (reply["error"], "ask again" in reply["reason"]) == ("busy", True)


def test_of_a_user_only_so_many_wait_for_one(rig: GatewayRig, reader: HeldReader) -> None:
    request = {"op": "calibration", "do": "get", "name": "P01"}
    waiting = [asked(rig, **request) for _ in range(BOUNDS["reading"].of_a_user)]
    assert rig.call(**request)["error"] == "busy"
    assert rig.call(op="arm")["ok"], "what the engine answers has a bound of its own"
    reader.found = READ
    for client in waiting:
        assert rig.reply(client)["ok"]


def test_one_that_takes_too_long_is_given_up_and_not_kept(
    rig: GatewayRig, reader: HeldReader
) -> None:
    client = asked(rig, op="calibration", do="get", name="P01")
    rig.clock.t_ns += READ_WITHIN_NS
    reply = rig.reply(client)
    assert (reply["error"], "longer than 8 s" in reply["reason"]) == ("bad_calibration", True)
    assert reader.cancelled == 1
    again = asked(rig, op="calibration", do="get", name="P01")
    reader.found = READ
    assert rig.reply(again)["ok"]


def test_users_take_turns() -> None:
    reader = HeldReader()
    readings = CalibrationReadings(reader, ParsedFiles(), lambda _: True)
    for ref in range(1, 4):
        readings.ask(ref, A_USER, [Path(f"of-a-{ref}.toml")])
    readings.ask(9, ANOTHER, [Path("of-b.toml")])
    answered: list[Answer] = []
    for _ in range(4):
        answered += readings.answers(0)
        reader.found = READ
    answered += readings.answers(0)
    assert reader.begun == ["of-a-1", "of-b", "of-a-2", "of-a-3"]
    assert [answer.ref for answer in answered] == [1, 9, 2, 3]
    assert readings.is_idle


def test_only_so_many_files_are_kept(tmp_path: Path) -> None:
    parsed = ParsedFiles()
    paths = [tmp_path / f"P{number}.toml" for number in range(MOST + 1)]
    for path in paths:
        path.write_text("")
        parsed.keep(path, seen(path), READ)
    assert parsed.get(paths[-1]) is READ
    assert parsed.get(paths[1]) is READ
    assert parsed.get(paths[0]) is None
    paths[1].unlink()
    assert parsed.get(paths[1]) is None
