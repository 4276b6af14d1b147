"""Where the campaign's outcomes are kept, and what they come to.

Owns: the files, one a board, which stand on a digest of all code that plays a case, so that a run
that was cut goes on where it stopped; and the figures of each class of faults. Must not know: how a
case is played, how a table looks.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

import msgspec

from campaign.case import Outcome

CLONE = Path(__file__).resolve().parents[2]
KEPT = CLONE / "build" / "campaign"
#: What chooses cases, and makes of outcomes what is shown: it plays none.
_SHOWN_BY = ("run.py", "choice.py", "docs.py", "record.py", "results.py", "judge.py")
PC_PER_UC = 1e6
#: The scene in which nobody is connected, but a resistor.
BENCH = "self-test"
#: Of a pulse: readings of skin tell no less.
_SMALL_PART = 0.2


@cache
def digest() -> str:
    """Of all code and settings that an outcome depends on: what this process has loaded of the
    clone, once the scenes are there, and all files of the configuration.
    """
    loaded = (getattr(module, "__file__", None) for module in tuple(sys.modules.values()))
    code = {Path(name).resolve() for name in loaded if name}
    shown_by = {Path(__file__).with_name(name) for name in _SHOWN_BY}
    paths = {path for path in code - shown_by if path.is_relative_to(CLONE)}
    paths = {path for path in paths if ".venv" not in path.parts}
    found = hashlib.sha256()
    for path in sorted(paths | set(CLONE.glob("config/**/*.toml"))):
        found.update(str(path.relative_to(CLONE)).encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]


@cache
def version() -> str:
    """Of the clone, as git describes it: as it was when it was asked first."""
    said = subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        cwd=CLONE, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return said.stdout.strip() or "not from a clone"


def now() -> str:
    """By the system's own command: in the tests no date is taken from a clock."""
    said = subprocess.run(["date", "-u", "+%F %H:%M UTC"], capture_output=True, check=True)
    return said.stdout.decode().strip()


def file_of(board: str, scene: str, folder: Path = KEPT) -> Path:
    return folder / digest() / f"{board} {scene}.jsonl"


def kept(path: Path) -> list[Outcome]:
    """All that is there; a last line that was cut off is left out."""
    try:
        whole = path.read_bytes().rpartition(b"\n")[0]
    except FileNotFoundError:
        return []
    return msgspec.json.Decoder(Outcome).decode_lines(whole)


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    """Of one class of faults. Charge in uC, beyond what flows without the fault."""

    fault_class: str
    cases: int
    #: Halted, refused, made safe, or ended with the program.
    told: int
    #: Not told, and no electrode got more than a pulse may differ by.
    latent: int
    #: Not told, and an electrode got more.
    silent: int
    crashed: int
    #: Of what was told, from the first current with the fault to the last: half of them, and the
    #: slowest.
    safe_p50_ms: float | None
    safe_most_ms: float | None
    #: Of what was silent: the most that an electrode got. None: not kept.
    silent_most_uc: float | None = None
    most_alone_uc: float
    most_shared_uc: float
    #: Of one processor, all its cases together; 0: not kept.
    processor_s: float = 0.0


def figures(outcomes: Iterable[Outcome]) -> list[Figures]:
    """By class, in the order in which they were first met."""
    by_class: defaultdict[str, list[Outcome]] = defaultdict(list)
    for one in outcomes:
        by_class[one.fault_class].append(one)
    return [figures_of(name, found) for name, found in by_class.items()]


def figures_of(fault_class: str, found: Sequence[Outcome]) -> Figures:
    """Of cases that have one name together: a class, or all."""
    times_ms = sorted(one.flowed_for_ms for one in found if is_told(one))
    silent_pc = [beyond_pc(one) for one in found if is_silent(one)]
    told = sum(map(is_told, found))
    crashed = sum(one.seen.startswith("crashed") for one in found)
    return Figures(
        fault_class=fault_class,
        cases=len(found),
        told=told,
        latent=len(found) - told - crashed - len(silent_pc),
        silent=len(silent_pc),
        crashed=crashed,
        safe_p50_ms=times_ms[len(times_ms) // 2] if times_ms else None,
        safe_most_ms=times_ms[-1] if times_ms else None,
        silent_most_uc=max(silent_pc, default=0.0) / PC_PER_UC,
        most_alone_uc=max(one.beyond_alone_pc for one in found) / PC_PER_UC,
        most_shared_uc=max(one.beyond_shared_pc for one in found) / PC_PER_UC,
        processor_s=round(sum(one.processor_s for one in found), 3),
    )


def where_of(one: Outcome) -> str:
    """The board that a person is at, or the bench."""
    return BENCH if one.scene == BENCH else one.board


def beyond_pc(one: Outcome) -> float:
    """Of the electrode that got most, in either way."""
    return max(one.beyond_alone_pc, one.beyond_shared_pc)


def is_told(one: Outcome) -> bool:
    return one.seen in ("halted", "refused", "made safe", "ended")


def is_silent(one: Outcome) -> bool:
    """Nothing was said of it, and an electrode got more than a pulse may differ by."""
    return one.seen == "nothing" and beyond_pc(one) > _SMALL_PART * one.pulse_pc
