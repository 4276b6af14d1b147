"""One fault at one operation: what became of it.

Owns: what is said of a case, and how much more flowed than without the fault. Must not know: which
cases there are, where results are kept, tables.
"""

from __future__ import annotations

import msgspec

from campaign.account import AccountedBody, Course
from campaign.kind import Kind
from campaign.operations import Port
from campaign.scene import Said

MS = 1_000_000
#: So much earlier than without the fault a pulse may come and be the same.
_SLACK_NS = MS


class Outcome(msgspec.Struct, frozen=True):
    """What one case led to. Charge is in pC; `alone` of an electrode that is stimulated, `shared`
    of a return.
    """

    board: str
    scene: str
    kind: str
    fault_class: str
    operation: int
    port: str
    #: `halted`, `refused`, `made safe`, `ended` (killed), `crashed: ` with the error, or `nothing`.
    seen: str
    #: From the fault to the halt; None without one.
    halted_after_ms: float | None
    #: From the first current that flowed with the fault there to the last.
    flowed_for_ms: float
    #: The largest that an electrode got beyond what it gets without the fault until then, or in one
    #: stretch of current.
    beyond_alone_pc: float
    beyond_shared_pc: float
    #: Of what was asked for in one visit of an electrode: a phase, or both.
    pulse_pc: int
    #: At the end, by the line that enables it, where there is one: though nothing wants it on.
    leaves_supply_on: bool = False
    why: str = ""
    #: Of the code that played it, as git describes it.
    version: str = ""
    #: The day and time on which its scene was begun.
    played: str = ""
    #: What it took of one processor.
    processor_s: float = 0.0


def outcome(
    board: str,
    scene: str,
    kind: Kind,
    operation: int,
    port: Port,
    said: Said,
    body: AccountedBody,
    begun_ns: int,
    now_ns: int,
    without: Course,
    pulse_pc: int,
    leaves_supply_on: bool,
) -> Outcome:
    """At the end of a case, whose fault came at `begun_ns` and was marked on the `body`."""
    now = body.account(now_ns)
    last_ns = body.last_ns or begun_ns
    flowed_for_ms = 0.0 if body.first_ns is None else (last_ns - body.first_ns) / MS
    allowed, longest = without.until(last_ns + kind.shifts_ms * MS + _SLACK_NS), without.last
    return Outcome(
        board,
        scene,
        kind.name,
        kind.fault_class,
        operation,
        port,
        said.seen,
        said.after_ms,
        flowed_for_ms,
        _beyond_pc(
            now.alone_pc,
            None if allowed is None else allowed.alone_pc,
            now.longest_alone_pc - longest.longest_alone_pc,
        ),
        _beyond_pc(
            now.shared_pc,
            None if allowed is None else allowed.shared_pc,
            now.longest_shared_pc - longest.longest_shared_pc,
        ),
        pulse_pc,
        leaves_supply_on,
        said.why,
    )


def _beyond_pc(
    now_pc: tuple[float, ...], allowed_pc: tuple[float, ...] | None, stretch_pc: float
) -> float:
    """By its whole charge, and by its longest stretch."""
    allowed_pc = allowed_pc or (0.0,) * len(now_pc)
    more_pc = max(now - allowed for now, allowed in zip(now_pc, allowed_pc, strict=True))
    return max(0.0, more_pc, stretch_pc)
