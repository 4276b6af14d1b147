"""What must hold of the campaign's outcomes: each class against its row in `bounds.toml`.

Owns: the form of that file, and the sentences of what does not hold. Must not know: how a case is
played, how a table looks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec

from campaign.case import Outcome
from campaign.engine_script import PULSE_PC
from campaign.record import Line
from campaign.results import BENCH, PC_PER_UC, beyond_pc, is_silent, is_told, where_of

FILE = Path(__file__).with_name("bounds.toml")
#: The class of drawn pairs.
PAIR: Final = "two at once"
GUARDED, RELAYS = "reference-hv507", "feetthrough-relay"
#: Beyond the programmed pulse, with the guards in hardware: the one-shot's 250 us at 10 mA. It is
#: asked where a person is connected. It is not asked at the bench of a self-test, with that board
#: either: what flows there flows through the resistor that is clipped on, for as long as a stage
#: takes to see that something is wrong, and arming, which is what connects a person, is refused
#: without its report. The bench has bounds of its own (`uc`).
MOST_UC: Final = 2.5
_ASKED_OF: Final = (GUARDED,)


class Bound(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Of a class of faults."""

    #: Rows of "What is checked while it runs" in docs/safety.md, on every board.
    told_by: tuple[str, ...] = ()
    #: The same on the board with all guards alone.
    guarded_by: tuple[str, ...] = ()
    #: Why nothing tells it, or not on some board, or not in each case.
    why: str = ""
    #: On these boards a case may be silent all the same; `why` says why.
    silent_on: tuple[str, ...] = ()
    #: Which hardware bounds it, where no guard of these boards does.
    needs: str = ""
    #: So much may be silent of a class that something tells, where it comes again and again in step
    #: with what is looked at; `why` says how. In uC, as below.
    in_step_uc: float = 0.0
    #: With all guards as one of a pair, whose other one takes a guard away; in uC, of any pulse.
    in_pair_uc: float = 0.0
    #: What a self-test says of it: checks of its report, as docs/bring-up.md names them. None: it
    #: does not tell this class, or only by chance, and `selftest_why` says why.
    selftest: tuple[str, ...] = ()
    selftest_why: str = ""
    #: So much a self-test that names checks may let through in silence: a fault that comes after
    #: they were made.
    selftest_silent_uc: float = 0.0
    #: By board: what is told flows no longer than this after the fault.
    within_ms: Mapping[str, float] = {}
    #: Why the supply may be on after a halt: what keeps it on is the fault itself.
    leaves_supply_on: str = ""
    #: By board, and on the bench of a self-test: the most that an electrode may get beyond what it
    #: gets without the fault, where a pulse has `PULSE_PC`; with stronger ones as much more.
    uc: Mapping[str, float] = {}

    def silent_most_uc(self, board: str) -> float:
        """What may be let through in silence where something tells it."""
        return self.selftest_silent_uc if board == BENCH else self.in_step_uc

    def rows_on(self, board: str) -> tuple[str, ...]:
        """What tells it there."""
        if board == BENCH:
            return self.selftest
        if board in self.silent_on:
            return ()
        return (*self.told_by, *(self.guarded_by if board == GUARDED else ()))


def bounds() -> dict[str, Bound]:
    """By class. Raises: msgspec.ValidationError."""
    return msgspec.toml.decode(FILE.read_bytes(), type=dict[str, Bound])


def not_met(found: Sequence[Outcome], rows: Mapping[str, Bound]) -> list[str]:
    """A sentence for each case that breaks its row."""
    return [
        f"{one.board}, {one.scene}, operation {one.operation} ({one.port}), {one.kind}: {why}"
        for one in found
        if (why := _why(one, rows))
    ]


def _bounding(one: Outcome, rows: Mapping[str, Bound]) -> list[Bound]:
    """Its row; of a pair also those of the two."""
    names = [one.fault_class]
    if one.fault_class == PAIR:
        # As `run` names them: the class and the variant of each.
        halves = one.kind.removeprefix(f"{PAIR}: ").split(", then ")
        names += [half.partition(": ")[0] for half in halves]
    return [rows[name] for name in names if name in rows]


def _why(one: Outcome, rows: Mapping[str, Bound]) -> str:
    row = rows.get(one.fault_class)
    beyond_uc = beyond_pc(one) / PC_PER_UC
    if one.seen.startswith("crashed"):
        return one.seen
    if row is None:
        return f"{FILE.name} has no row for it"
    where, times = where_of(one), one.pulse_pc / PULSE_PC
    told_by = row.rows_on(where)
    if is_silent(one) and told_by and beyond_uc > row.silent_most_uc(where) * times:
        return f"{beyond_uc:.3f} uC in silence, and it should be told by {told_by[0]}"
    bounding = _bounding(one, rows)
    if one.leaves_supply_on and not any(it.leaves_supply_on for it in bounding):
        return "the supply was left on"
    late = _too_late(row, where, one.flowed_for_ms) if is_told(one) else ""
    return late or _too_much(bounding, where, times, beyond_uc)


def _too_late(row: Bound, where: str, flowed_ms: float | None) -> str:
    within_ms = row.within_ms.get(where)
    if within_ms is None or flowed_ms is None or flowed_ms <= within_ms:
        return ""
    return f"{flowed_ms:.1f} ms until it is silent, more than the {within_ms:g} ms of its row"


def _too_much(bounding: Sequence[Bound], where: str, times: float, beyond_uc: float) -> str:
    """`bounding`: the largest of these is what may be let through."""
    most_uc = max(bound.uc.get(where, 0.0) for bound in bounding) * times
    if where in _ASKED_OF and len(bounding) > 1:
        most_uc = max(most_uc, *(bound.in_pair_uc for bound in bounding))
    if beyond_uc > most_uc:
        return f"{beyond_uc:.3f} uC, more than the {most_uc:g} uC of its row"
    if where in _ASKED_OF and beyond_uc > MOST_UC and not any(one.needs for one in bounding):
        return f"{beyond_uc:.1f} uC with all guards, and no hardware is named that would bound it"
    return ""


def lines_not_met(lines: Sequence[Line], rows: Mapping[str, Bound]) -> list[str]:
    """Of what is recorded: a sentence for each class that breaks its row."""
    return [
        f"{line.on}, pulses of {line.pulse_pc / PC_PER_UC:g} uC, {line.fault_class}: {why}"
        for line in lines
        if (why := _why_of_class(line, rows))
    ]


def _why_of_class(line: Line, rows: Mapping[str, Bound]) -> str:
    """Which two a pair was is not recorded: it was judged by them when it was played."""
    row = rows.get(line.fault_class)
    if line.crashed:
        return f"{line.crashed} ended by an error of their own"
    if row is None:
        return f"{FILE.name} has no row for it"
    told_by, times = row.rows_on(line.on), line.pulse_pc / PULSE_PC
    if told_by and _is_too_silent(line, row.silent_most_uc(line.on) * times):
        size = "of a size that was not kept"
        if line.silent_most_uc is not None:
            size = f"of {line.silent_most_uc:.3f} uC at most"
        return f"{line.silent} in silence, {size}, and it should be told by {told_by[0]}"
    if late := _too_late(row, line.on, line.safe_most_ms):
        return late
    bounding = list(rows.values()) if line.fault_class == PAIR else [row]
    return _too_much(bounding, line.on, times, line.most_uc)


def _is_too_silent(line: Line, allowed_uc: float) -> bool:
    """Where the size was not kept, anything allowed is taken for enough."""
    if line.silent_most_uc is None:
        return line.silent > 0 and not allowed_uc
    return line.silent_most_uc > allowed_uc
