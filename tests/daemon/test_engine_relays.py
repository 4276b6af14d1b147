"""Relays take milliseconds to connect: what comes meanwhile is heard before the pulse."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import MS, armed, moves, only, phases
from etd.protocol.link import CloseLease, DisarmBoard, StopNow

MakeRig = Callable[..., EngineRig]


@pytest.mark.parametrize(
    ("command", "state"),
    [
        (StopNow(ref=0, client="operator"), "HALTED"),
        (DisarmBoard(ref=0, lease=LEASE), "SAFE"),
        (CloseLease(ref=0, lease=LEASE), "SAFE"),
    ],
    ids=["stop", "disarm", "close"],
)
def test_what_comes_while_relays_move_is_heard_before_the_pulse(
    make_rig: MakeRig, command: StopNow | DisarmBoard | CloseLease, state: str
) -> None:
    rig = armed(make_rig("feetthrough-relay"))
    rig.show(current_ua=only(32, e3=500), rate_hz=10.0, ttl_ms=1_000)
    rig.run_ms(150)
    next_ns = phases(rig)[-1].from_ns + 100 * MS
    # The relays take 1 ms to close.
    asked_ns = next_ns - 500_000
    rig.clock.at(asked_ns, lambda: rig.commands.send(command))
    rig.run_ms(110)
    assert any(asked_ns - MS < t_ns < asked_ns for t_ns, _ in moves(rig, "LE"))
    assert phases(rig, asked_ns) == []
    assert rig.state == state
