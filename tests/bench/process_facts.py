"""What a process takes: memory, and of a processor.

Owns: reading the kernel's account. Must not know: what they do.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

_PROC = Path("/proc")
#: In `stat`, behind the name: ticks in user and kernel mode.
_USER, _KERNEL = 11, 12


@dataclass(frozen=True)
class ProcessFacts:
    """Of one process."""

    name: str
    #: What goes to it of memory that is shared, and what is its alone.
    proportional_kb: int
    private_kb: int
    processor_s: float
    threads: int


def facts_of(name: str, pid: int) -> ProcessFacts:
    """Raises: OSError, where it has ended."""
    stat, memory = _stat(pid), _memory(pid)
    ticks = int(stat[_USER]) + int(stat[_KERNEL])
    return ProcessFacts(
        name,
        memory["Pss"],
        memory["Private_Clean"] + memory["Private_Dirty"],
        ticks / os.sysconf("SC_CLK_TCK"),
        len(list((_PROC / str(pid) / "task").iterdir())),
    )


def _stat(pid: int) -> list[str]:
    return (_PROC / str(pid) / "stat").read_text("utf-8").rpartition(")")[2].split()


def _memory(pid: int) -> dict[str, int]:
    lines = (_PROC / str(pid) / "smaps_rollup").read_text("ascii").splitlines()
    words = (line.split() for line in lines)
    return {found[0].rstrip(":"): int(found[1]) for found in words if found[-1] == "kB"}
