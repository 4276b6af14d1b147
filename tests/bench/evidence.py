"""`make evidence`: the figures on safety, measured now on this machine, as docs/evidence.md.

Owns: which commands are run, the page, and what it says of machine, date and version. A command
that fails, or that is not there, is on the page as that; exit status 1 then. Must not know: what is
measured, what the figures mean.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from etd.client import clock

_CLONE = Path(__file__).resolve().parents[2]
PAGE = _CLONE / "docs" / "evidence.md"


@dataclass(frozen=True)
class Measurement:
    """A command whose standard output is JSON; `short`: what takes minutes in place of hours."""

    title: str
    command: str
    short: str
    about: str


MEASUREMENTS = (
    Measurement(
        "A fault at every operation",
        "tests/campaign/run.py --json --write",
        "tests/campaign/run.py --json --bounded --boards kajimoto-hv507 reference-hv507",
        "The judge is the body's own account of charge; the table by fault class is in"
        " [safety.md](safety.md#what-each-failure-lets-through).",
    ),
    Measurement(
        "A thousand kills",
        "tests/bench/kills.py --json",
        "tests/bench/kills.py --json --kills 20",
        "What flows after a kill, how long until the board is safe, what is remembered.",
    ),
    Measurement(
        "A stop while strangers do what they can",
        "tests/bench/attack.py --json",
        "tests/bench/attack.py --json --stops 20",
        "Heard: until the engine has it. Answered: until the reply is there.",
    ),
    Measurement(
        "An hour beside a load, and a thousand starts",
        "tests/bench/soak.py --json",
        "tests/bench/soak.py --json --seconds 60 --restarts 10",
        "Memory and descriptors of the whole daemon: after the warm-up, and at the end.",
    ),
    Measurement(
        "An hour of bytes from outside",
        "tests/fuzz/run.py --json",
        "tests/fuzz/run.py --json --seconds 120",
        "Each target decodes what clients, files or a peer may send; what it demands is in"
        " [architecture.md](architecture.md).",
    ),
)


@dataclass(frozen=True)
class Measured:
    measurement: Measurement
    command: str
    status: int
    seconds: float
    figures: Any
    #: What it said, where it gave no figures.
    said: str


def measured(measurement: Measurement, *, is_short: bool) -> Measured:
    """Runs it; what it says on standard error is shown as it comes."""
    command = measurement.short if is_short else measurement.command
    begun_ns = clock.now_ns()
    ended = subprocess.run(
        [sys.executable, *command.split()], cwd=_CLONE, stdout=subprocess.PIPE, check=False
    )
    seconds = (clock.now_ns() - begun_ns) / 1e9
    text = ended.stdout.decode(errors="replace").strip()
    try:
        figures = json.loads(text.splitlines()[-1] if text else "null")
    except ValueError:
        figures = None
    return Measured(measurement, command, ended.returncode, seconds, figures, text[-500:])


# --- the page ------------------------------------------------------------------------------------


def page(found: Sequence[Measured], *, is_short: bool) -> str:
    """As Markdown."""
    how = " ARGS=--short" if is_short else ""
    lines = [
        "# Evidence",
        "",
        f"What `make evidence{how}` measured. It is written by that command, and by nothing else.",
        "",
        *(f"- {what}: {value}" for what, value in machine().items()),
    ]
    for one in found:
        lines += ["", f"## {one.measurement.title}", "", one.measurement.about, ""]
        met = "its bounds were met" if one.status == 0 else f"exit status {one.status}: NOT met"
        lines += [f"`python {one.command}`: {one.seconds:.0f} s, {met}.", ""]
        lines += rendered(one.figures) if one.figures is not None else ["```", one.said, "```"]
    return "\n".join(lines) + "\n"


def machine() -> dict[str, str]:
    described = subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        cwd=_CLONE, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return {
        "date": _date(),
        "version": described.stdout.strip() or "not from a clone",
        "machine": f"{_processor()}, {os.cpu_count()} cores, {platform.machine()}",
        "system": f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
    }


def _date() -> str:
    """By the system's own command: in the tests no date is taken from a clock."""
    said = subprocess.run(["date", "-u", "+%F %H:%M UTC"], capture_output=True, check=True)
    return said.stdout.decode().strip()


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
        if line.startswith(("model name", "Model")):
            return line.partition(":")[2].strip()
    return "a processor without a name"


def rendered(figures: Any) -> list[str]:
    """A list of objects is a table, an object a list; what is nested is in one cell."""
    if isinstance(figures, dict):
        tables = {key: value for key, value in figures.items() if _is_table(value)}
        lines = [
            f"- {_words(key)}: {_cell(value)}"
            for key, value in figures.items()
            if key not in tables
        ]
        for key, rows in tables.items():
            lines += ["", f"{_words(key)}:", "", *_table(rows)]
        return lines
    return _table(figures) if _is_table(figures) else [_cell(figures)]


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(it, dict) for it in value)


def _table(rows: Sequence[dict[str, Any]]) -> list[str]:
    columns = list(dict.fromkeys(key for row in rows for key in row))
    return [
        "| " + " | ".join(map(_words, columns)) + " |",
        "|" + "---|" * len(columns),
        *("| " + " | ".join(_cell(row.get(key)) for key in columns) + " |" for row in rows),
    ]


def _cell(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{_words(key)} {_cell(inner)}" for key, inner in value.items()) or "-"
    if isinstance(value, list):
        return ", ".join(map(_cell, value)) or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return "-" if value is None else str(value).replace("|", "/")


def _words(key: str) -> str:
    return key.replace("_", " ")


def main(arguments: Iterable[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="evidence", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--short", action="store_true", help="minutes in place of hours")
    parser.add_argument("--page", type=Path, default=PAGE, help="where to write (docs/evidence.md)")
    args = parser.parse_args(None if arguments is None else list(arguments))
    console, found = Console(stderr=True), []
    for measurement in MEASUREMENTS:
        console.print(f"[bold]{measurement.title}[/bold]")
        found.append(measured(measurement, is_short=args.short))
    args.page.write_text(page(found, is_short=args.short), encoding="utf-8")
    console.print(f"written: {args.page}")
    return 0 if all(one.status == 0 for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())
