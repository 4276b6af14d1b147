"""What the guards of a board file are in lines, levels and milliseconds.

Owns: the stop lines by name, an input's edge that counts, the call that makes a board safe, and for
how long an engine may be silent. Must not know: ports, when any of it is used.
"""

from __future__ import annotations

from typing import Literal

from etd_hal.bench import StopName
from etd_hal.boardfile import BoardFile, EdgeInput, Guards
from etd_hal.ports import Changes

#: Where no board file names a heartbeat's window: the longest that one may name.
SILENT_MS = 100


def window_ms(guards: Guards) -> int:
    return SILENT_MS if guards.heartbeat == "absent" else guards.heartbeat.window_ms


def stop_lines(guards: Guards) -> dict[StopName, int]:
    lines: dict[StopName, int | Literal["absent"]] = {
        "emergency_stop": guards.emergency_stop,
        "wearer_stop": guards.wearer_stop,
    }
    return {name: line for name, line in lines.items() if line != "absent"}


def edge_of(found: EdgeInput | Literal["absent"]) -> tuple[int, int] | None:
    """Its line, and the level after the edge that counts."""
    return None if found == "absent" else (found.line, int(found.edge == "rising"))


def safe_changes(file: BoardFile) -> Changes:
    """One call: the switch's lines, and the supply off. One call cannot open relays."""
    enable = file.guards.hv_enable
    supply: Changes = () if enable == "absent" else ((enable.line, 1 - enable.on),)
    switch = file.switch
    blanked = ((getattr(switch.lines, name), level) for name, level in switch.safe_levels)
    return tuple(sorted((*blanked, *supply)))
