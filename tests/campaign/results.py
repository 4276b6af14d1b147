"""Where the campaign's outcomes are kept, and what they come to.

Owns: the files, one a board, which stand on a digest of all code that plays a case, so that a run
that was cut goes on where it stopped; and the figures of each class of faults. Must not know: how a
case is played, how a table looks.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec

from campaign.case import Outcome

CLONE = Path(__file__).resolve().parents[2]
KEPT = CLONE / "build" / "campaign"
_PLAYED_BY = (
    *("daemon/**/*.py", "hal/**/*.py", "config/**/*.toml", "tests/campaign/*.py"),
    *("tests/engine_rig.py", "tests/engine_scenes.py", "tests/stepped_stopper.py"),
    "tests/charge_witness.py",
)
PC_PER_UC = 1e6
#: A fifth of a pulse: readings of skin tell no less.
SMALL_PC = 4_000.0


@cache
def digest() -> str:
    """Of all code and settings that an outcome depends on."""
    paths = {path for pattern in _PLAYED_BY for path in CLONE.glob(pattern)}
    found = hashlib.sha256()
    for path in sorted(paths):
        found.update(str(path.relative_to(CLONE)).encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]


def file_of(board: str, folder: Path = KEPT) -> Path:
    return folder / digest() / f"{board}.jsonl"


def kept(path: Path) -> list[Outcome]:
    """All that is there; a last line that was cut off is left out."""
    try:
        whole = path.read_bytes().rpartition(b"\n")[0]
    except FileNotFoundError:
        return []
    return msgspec.json.Decoder(Outcome).decode_lines(whole)


@dataclass(frozen=True)
class Figures:
    """Of one class of faults, on some boards. Charge in uC, beyond what flows without the fault."""

    fault_class: str
    cases: int
    halted: int
    refused: int
    ended: int
    #: Neither halted nor refused, and no electrode got more than a pulse may differ by.
    harmless: int
    #: Neither halted nor refused, and an electrode got more.
    silent: int
    crashed: int
    #: From the fault to the halt: half of them, and the slowest.
    halted_p50_ms: float | None
    halted_most_ms: float | None
    most_alone_uc: float
    most_shared_uc: float


def figures(outcomes: Iterable[Outcome]) -> list[Figures]:
    """By class, in the order in which they were first met."""
    by_class: defaultdict[str, list[Outcome]] = defaultdict(list)
    for one in outcomes:
        by_class[one.fault_class].append(one)
    return [_figures(name, found) for name, found in by_class.items()]


def _figures(fault_class: str, found: Sequence[Outcome]) -> Figures:
    times_ms = sorted(one.halted_after_ms for one in found if one.halted_after_ms is not None)
    silent = sum(is_silent(one) for one in found)
    unseen = sum(one.seen == "nothing" for one in found)
    return Figures(
        fault_class,
        len(found),
        sum(one.seen == "halted" for one in found),
        sum(one.seen == "refused" for one in found),
        sum(one.seen == "ended" for one in found),
        unseen - silent,
        silent,
        sum(one.seen.startswith("crashed") for one in found),
        times_ms[len(times_ms) // 2] if times_ms else None,
        times_ms[-1] if times_ms else None,
        max(one.beyond_alone_pc for one in found) / PC_PER_UC,
        max(one.beyond_shared_pc for one in found) / PC_PER_UC,
    )


def is_silent(one: Outcome) -> bool:
    """Nothing was said of it, and an electrode got more than a pulse may differ by."""
    return one.seen == "nothing" and max(one.beyond_alone_pc, one.beyond_shared_pc) > SMALL_PC
