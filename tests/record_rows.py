"""Rows and lines of a record as tests write them.

Owns: a record's beginning and end, a frame, and a pulse in which nothing is missing. Must not know:
what is made of them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from etd.protocol.messages import Limits
from etd.protocol.pulse_row import PulseRow
from etd.record import lines
from etd.record.lines import Line
from scripted_engine import engine_hello

MS = 1_000_000
WALL_NS = 1_790_000_000_000_000_000
HEADER = lines.Header(
    format=1,
    name="p01",
    etd="0.1.0",
    daemon="main",
    protocol=1,
    begun="2026-09-21T13:33:20.000+00:00",
    begun_ns=0,
    uid=1,
    columns=PulseRow.__struct_fields__,
)
BEGINNING: tuple[Line, ...] = (
    HEADER,
    lines.Clocks(t_ns=0, wall_ns=WALL_NS, uncertainty_ns=100),
    lines.Engine(t_ns=1, facts=engine_hello()),
    lines.LeaseBegun(
        t_ns=2, client="study", uid=1, limits=Limits(max_current_ua=3000, width_us=100)
    ),
)
END = lines.End(t_ns=9_000 * MS, why="stopped")


def frame(number: int, seq: int, t_ms: int, **fields: Any) -> lines.Asked:
    request = {"op": "frame", "seq": seq, **fields}
    return lines.Asked(t_ns=t_ms * MS, number=number, client="study", uid=1, request=request)


def stored(folder: Path, *all_lines: Line, torn: bytes = b"") -> Path:
    path = folder / "p01.jsonl"
    path.write_bytes(b"".join(map(lines.encoded, all_lines)) + torn)
    return path


def pulse(t_ms: float, electrode: int, seq: int | None, current_ua: int, **fields: Any) -> PulseRow:
    values: dict[str, Any] = {
        "t_ns": int(t_ms * MS),
        "asked_ns": int(t_ms * MS),
        "electrode": electrode,
        "purpose": "poll" if seq is None else "stimulus",
        "seq": seq,
        "polarity": "anodic",
        "wanted_ua": current_ua,
        "current_ua": current_ua,
        "prepulse_ua": 0,
        "width_us": 100.0,
        "charge_nc": current_ua / 10,
        "delivered_ua": current_ua - 100,
        "resistance_ohm": 40_000,
        "contact": "closed",
        "limited": None,
        "limited_by": None,
        "samples_v": (0.0, 20.0, 40.0),
        **fields,
    }
    return PulseRow(**values)
