"""Who may arm the board and clear a halt: one rule for all that needs the right to operate."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from etd.gateway.config import GatewayConfig, Operators
from etd.gateway.server import Gateway
from etd.protocol.errors import FileError, Refused
from etd.protocol.link import ClearHalt, StopNow
from gateway_rig import GatewayRig, HandClock
from raw_client import connected, hello, part

STRANGER = 65_533


@contextmanager
def as_stranger(rig: GatewayRig) -> Iterator[Callable[..., dict[str, Any]]]:
    """A request from a connection that another user has made, and its reply."""
    path = rig.folder / "control.sock"
    for place, mode in ((rig.folder.parent, 0o755), (rig.folder, 0o755), (path, 0o666)):
        place.chmod(mode)
    os.seteuid(STRANGER)
    try:
        theirs = connected(path)
    finally:
        os.seteuid(0)

    def call(op: str, **fields: str) -> dict[str, Any]:
        theirs.send(part(json.dumps({"op": op, **fields}).encode()))
        got = b""

        def is_whole() -> bool:
            nonlocal got
            with contextlib.suppress(BlockingIOError):
                got += theirs.recv(65_536)
            return b'{"ok"' in got and got.endswith(b"}")

        rig.until(is_whole)
        reply = json.loads(got[got.index(b'{"ok"') :])
        assert isinstance(reply, dict)
        return reply

    with theirs:
        theirs.send(hello("DEALER"))
        yield call


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_only_operators_arm_clear_and_measure() -> None:
    with GatewayRig(operators=(str(STRANGER + 1),)) as rig, as_stranger(rig) as theirs:
        for op in ("arm", "clear", "measure"):
            # Of `measure`, whatever its lease is.
            reply = theirs(op, lease="that does not stand") if op == "measure" else theirs(op)
            assert reply["error"] == "not_permitted"
            assert str(STRANGER) in reply["reason"]
        assert rig.engine.heard == []
        assert theirs("stop")["ok"], "everybody may stop"
    with GatewayRig(operators=(str(STRANGER),)) as rig, as_stranger(rig) as theirs:
        assert theirs("arm")["ok"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
@pytest.mark.parametrize(
    ("operators", "is_operator"), [((), False), ((str(STRANGER),), True)], ids=["none", "named"]
)
def test_the_engine_is_told_who_stops_and_who_clears(
    operators: tuple[str, ...], *, is_operator: bool
) -> None:
    with GatewayRig(operators=operators) as rig, as_stranger(rig) as theirs:
        assert theirs("stop")["ok"]
        assert theirs("clear")["ok"]
        assert rig.call(op="clear")["ok"]
        stop, clear, ours = rig.engine.heard
        assert isinstance(stop, StopNow)
        assert isinstance(clear, ClearHalt)
        assert isinstance(ours, ClearHalt)
        assert (stop.uid, clear.uid, ours.uid) == (STRANGER, STRANGER, os.geteuid())
        assert (clear.is_operator, ours.is_operator) == (is_operator, True)


@pytest.mark.parametrize("uid", [0, os.geteuid()], ids=["root", "the gateway's own user"])
def test_who_has_the_gateways_files_anyhow_operates_too(uid: int) -> None:
    """One rule for arming, clearing and records."""
    operators = Operators((str(STRANGER),))
    assert operators.is_one(uid)
    operators.check(uid)
    with pytest.raises(Refused, match="no operate rights"):
        operators.check(STRANGER + 1)
    with pytest.raises(Refused, match="no operate rights"):
        operators.check(None)


def test_of_operators_by_name_the_gateways_own_user_arms() -> None:
    with GatewayRig(operators=(str(STRANGER),)) as rig:
        assert rig.call(op="arm")["ok"]


def test_an_unknown_operator_is_refused_at_start(tmp_path: Path) -> None:
    config = GatewayConfig(
        name="x", runtime_folder=tmp_path, state_dir=tmp_path, operators=("nobody-of-that-name",)
    )
    with pytest.raises(FileError, match="no user 'nobody-of-that-name'"):
        Gateway(config, HandClock())
