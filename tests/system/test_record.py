"""A record by commands: beside a client, and with the gateway killed within a stimulus."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_rig import WITHIN_S, CommandRig, command_rig, wait_for_end
from etd.client import Display, clock
from etd.protocol.errors import EtdError

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def said_by(rig: CommandRig, *words: str) -> str:
    said = rig.run(*words)
    assert (said.status, said.err) == (0, ""), said
    return said.out


def records(rig: CommandRig) -> list[Path]:
    return sorted((rig.folder / "state").rglob("records/*.jsonl"))


def test_a_record_is_begun_noted_in_ended_and_looked_at(rig: CommandRig) -> None:
    with rig.daemon("--timeout-factor", "10"):
        said_by(rig, "record", "start", "p01")
        assert "p01" in said_by(rig, "status", "--json")
        said_by(rig, "note", "a remark")
        refused = rig.run("record", "start", "p02")
        assert refused.status == 1
        assert "stop it first" in refused.err
        said_by(rig, "record", "stop")
        assert "a remark" in said_by(rig, "record", "csv", "p01")
        assert "stopped" in said_by(rig, "record", "show", "p01")
        listed = json.loads(said_by(rig, "record", "list", "--json"))
        assert [facts["name"] for facts in listed["records"]] == ["p01"]
        fetched = rig.folder / "p01.jsonl"
        said_by(rig, "record", "get", "p01", str(fetched))
        assert [fetched.read_bytes()] == [path.read_bytes() for path in records(rig)]
        again = rig.run("record", "get", "p01", str(fetched))
        assert again.status == 1
        assert "not overwritten" in again.err
        assert "a remark" in said_by(rig, "record", "csv", str(fetched))
        report = ("report", "--board", "fake", "--record")
        by_name = json.loads(said_by(rig, *report, "p01", "--json"))
        by_file = json.loads(said_by(rig, *report, str(fetched), "--json"))
        assert by_name["record"] == by_file["record"]
        assert by_name["record_differs"] == []
        none = rig.folder / "none.jsonl"
        assert "p03" in rig.run("record", "get", "p03", str(none)).err
        assert not none.exists(), "what is refused leaves no file"
        said_by(rig, "record", "delete", "p01")
        assert records(rig) == []


def test_a_gateway_that_is_killed_leaves_a_record_that_opens(rig: CommandRig) -> None:
    with rig.daemon("--record", "p01", "--timeout-factor", "10") as daemon:
        parts = daemon.children()
        address = f"ipc://{next((rig.folder / 'run').rglob('control.sock'))}"
        with Display(address=address) as display:
            display.arm(open_to=0.2)
            deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
            try:
                display.show({27: 0.2}, ttl_ms=900)
                clock.sleep_s(0.5)
                os.kill(parts["gateway"], signal.SIGKILL)
                while clock.now_ns() < deadline_ns:
                    display.show({27: 0.2}, ttl_ms=900)
            except EtdError:
                pass
        ended = daemon.ended()
        assert "gateway ended" in ended.err
        wait_for_end(list(parts.values()))
    (path,) = records(rig)
    summary = json.loads(said_by(rig, "record", "show", str(path), "--json"))["summary"]
    assert summary["ended"] is None
    assert summary["pulses"] > 0
    assert "CUT OFF" in said_by(rig, "record", "show", str(path))
