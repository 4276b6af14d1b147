"""One fault at one operation: what became of it.

Owns: playing a scene with it, and what is said of its end. Must not know: which cases there are,
where results are kept, tables.
"""

from __future__ import annotations

import msgspec

from campaign.account import Account, AccountedBody
from campaign.scenes import PULSE_PC, STOPPED_BY
from engine_rig import EngineRig
from engine_scenes import halts

MS = 1_000_000


class Outcome(msgspec.Struct, frozen=True):
    """What one case led to. Charge is in pC; `alone` of the electrode that is stimulated, `shared`
    of a return.
    """

    board: str
    kind: str
    fault_class: str
    operation: int
    port: str
    #: `halted`, `refused`, `ended` (killed), `crashed: ` with the error, or `nothing`.
    seen: str
    #: From the fault to the halt; None without one.
    halted_after_ms: float | None
    #: The largest that an electrode got beyond what it gets without the fault, in all or in one
    #: stretch of current.
    beyond_alone_pc: float
    beyond_shared_pc: float
    why: str = ""


def outcome(
    board: str,
    kind: str,
    fault_class: str,
    operation: int,
    port: str,
    rig: EngineRig,
    body: AccountedBody,
    begun_ns: int,
    allowed: Account,
    end: str | None,
) -> Outcome:
    """The fault came at `begun_ns`. `allowed`: what flows in all without it; `end`: how the script
    ended where it did not come to its end.
    """
    now = body.account(rig.clock.now_ns())
    rig.listen()
    halted = [halt for halt in halts(rig) if halt.t_ns >= begun_ns]
    # The script's own stop is no finding.
    is_found = bool(halted) and halted[0].source != STOPPED_BY
    why = f"{halted[0].source}: {halted[0].detail}" if is_found else ""
    after_ms = (halted[0].t_ns - begun_ns) / MS if why else None
    return Outcome(
        board,
        kind,
        fault_class,
        operation,
        port,
        end or ("halted" if why else _otherwise(rig)),
        after_ms,
        _beyond_pc(now.alone_pc, allowed.alone_pc, now.longest_alone_pc),
        _beyond_pc(now.shared_pc, allowed.shared_pc, now.longest_shared_pc),
        why,
    )


def _otherwise(rig: EngineRig) -> str:
    if any(answer.error is not None for answer in rig.answers.values()):
        return "refused"
    return "nothing"


def _beyond_pc(
    now_pc: tuple[float, ...], allowed_pc: tuple[float, ...], longest_pc: float
) -> float:
    """By its whole charge, and by its longest stretch: a halt leaves much of the whole unused."""
    more_pc = max(now - allowed for now, allowed in zip(now_pc, allowed_pc, strict=True))
    return max(0.0, more_pc, longest_pc - PULSE_PC)
