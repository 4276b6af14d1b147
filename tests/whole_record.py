"""A record with a line of each kind, for tests that damage it.

Owns: its lines. Must not know: what is made of them.
"""

from __future__ import annotations

import json
from typing import Any

from etd.protocol.carried import CarriedOver, RampState, SoftStartState
from etd.protocol.messages import Halt, Limits, RefusedReport, Shown, StateReport
from etd.protocol.outcome import Clamp, Shortfall
from etd.record import lines
from etd.record.lines import Line
from record_rows import HEADER, pulse
from scripted_engine import engine_hello

MS = 1_000_000


def asked(number: int, t_ms: int, **request: Any) -> lines.Asked:
    return lines.Asked(t_ns=t_ms * MS, number=number, client="study", uid=1, request=request)


RECORD: tuple[Line, ...] = (
    HEADER,
    lines.Clocks(t_ns=0, wall_ns=1_790_000_000 * 10**9, uncertainty_ns=100, clock_lag_us=10),
    lines.Engine(t_ns=1, facts=engine_hello()),
    lines.LeaseBegun(
        t_ns=2, client="study", uid=1, limits=Limits(max_current_ua=3000, width_us=100)
    ),
    lines.Carried(
        carried=CarriedOver(
            t_ns=3,
            state="SAFE",
            soft_start=SoftStartState(
                array=RampState(reached_ua=900, rises=((2, 900),)), recontacts={1: RampState()}
            ),
            has_session=True,
        ),
    ),
    asked(1, 50, op="arm"),
    lines.Replied(t_ns=51 * MS, number=1, ok=True),
    lines.State(report=StateReport(state="ARMED", now_ns=52 * MS, engine="there")),
    asked(2, 100, op="frame", seq=1, level=[0.5, 0.0, 0.0, 0.25], rate_hz=50.0, tag=3),
    lines.Replied(t_ns=101 * MS, number=2, ok=True, reply={"seq": 1, "rate_hz": 50.0}),
    lines.Pulses(rows=(pulse(110, 0, 1, 1_000), pulse(130, 3, 1, 900, limited="cap"))),
    lines.Scans(
        now_ns=140 * MS,
        shown=(
            Shown(
                seq=1,
                tag=3,
                begun_ns=109 * MS,
                first_ns=110 * MS,
                last_ns=130 * MS,
                ended=True,
                ended_ns=135 * MS,
            ),
        ),
        scans=2,
        clamped=(Clamp(electrode=3, wanted_ua=1_000, allowed_ua=900, reason="cap", limited_by=3),),
        not_fired=(Shortfall(electrode=0, reason="ledger", pulses=1),),
    ),
    asked(3, 150, op="frame", seq=2, level=[0.0, 0.0, 0.0, 0.0]),
    asked(4, 160, op="mark", tag="now"),
    lines.Replied(t_ns=161 * MS, number=4, ok=True, reply={"marked_ns": 160 * MS, "sync": False}),
    asked(0, 400, op="frame", seq=3, current_ua=[0, 800, 0, 0], ttl_ms=500),
    lines.Pulses(rows=(pulse(410, 1, 3, 0), pulse(415, 2, None, 300), pulse(430, 1, 3, 800))),
    lines.Refusal(
        report=RefusedReport(now_ns=440 * MS, error="old_seq", reason="old", count=1, seq=3)
    ),
    lines.Note(t_ns=600 * MS, text="a remark", uid=1),
    lines.Lost(t_ns=610 * MS, pulses=2),
    lines.Halted(report=Halt(cause="stop", source="study", detail="asked", t_ns=700 * MS)),
    lines.LeaseEnded(t_ns=701 * MS, reason="halted"),
    lines.EngineGone(t_ns=702 * MS),
    lines.End(t_ns=9_000 * MS, why="stopped"),
)
WHOLE: list[Any] = [json.loads(lines.encoded(line)) for line in RECORD]
