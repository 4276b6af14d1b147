"""`make evidence`: the figures on safety, measured now on this machine, as docs/evidence.md.

Owns: which commands are run, the page, and what each of its sections says of date, machine and
version. What is not measured this time keeps the section that it has, so that hours can be spread;
what never was says so. A command that fails, or that is not there, is on the page as that; exit
status 1 then. Must not know: what is measured, what the figures mean.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from etd.client import clock
from etd.version import __version__

_CLONE = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(_CLONE / "tests")]

from bench.evidence_age import ages  # noqa: E402

PAGE = _CLONE / "docs" / "evidence.md"
#: By the measurements, while others still run.
_WRITTEN = frozenset(
    {
        *("docs/evidence.md", "docs/safety.md", "tests/campaign/recorded.jsonl"),
        *("tests/fuzz/fuzzed.txt", "tests/mutants/digests.toml"),
    }
)


@dataclass(frozen=True)
class Measurement:
    """A command whose standard output is JSON; `short`: what takes minutes in place of hours.
    `name`: what `--only` calls it.
    """

    name: str
    title: str
    command: str
    short: str
    about: str
    #: Of its figures, what another page shows.
    left_out: tuple[str, ...] = ()
    #: What shows and judges the figures that it keeps, each part with its version and day, and
    #: measures nothing; "": it keeps none.
    recorded: str = ""


MEASUREMENTS = (
    Measurement(
        "campaign",
        "A fault at operations of every place of the code",
        "tests/campaign/run.py --json --write",
        "tests/campaign/run.py --json --bounded --boards kajimoto-hv507 reference-hv507",
        "The judge is the body's own account of charge; the table by fault class is in"
        " [safety.md](safety.md#what-each-failure-lets-through).",
        left_out=("by_class",),
        recorded="tests/campaign/run.py --recorded --json --write",
    ),
    Measurement(
        "kills",
        "A thousand kills",
        "tests/bench/kills.py --json",
        "tests/bench/kills.py --json --kills 20 --silences 5",
        "What flows after a kill, how long until the board is safe, what is remembered.",
    ),
    Measurement(
        "attack",
        "A stop while strangers do what they can",
        "tests/bench/attack.py --json",
        "tests/bench/attack.py --json --stops 20",
        "Heard: until the engine has it. Answered: until the reply is there.",
    ),
    Measurement(
        "soak",
        "An hour beside a load, and a thousand starts",
        "tests/bench/soak.py --json",
        "tests/bench/soak.py --json --seconds 60 --restarts 10",
        "Memory and descriptors of the whole daemon: after the warm-up, and at the end.",
    ),
    Measurement(
        "fuzz",
        "An hour of bytes from outside",
        "tests/fuzz/run.py --json",
        "tests/fuzz/run.py --json --seconds 120",
        "Each target decodes what clients, files or a peer may send; what it demands is in"
        " [architecture.md](architecture.md).",
    ),
    Measurement(
        "mutants",
        "Mistakes in what bounds current",
        "tests/mutants/run.py --json",
        "tests/mutants/run.py --json guard",
        "One mistake after another in the source, and which of them no test sees. What was tried"
        " over the same sources before is not tried again: the time is of the rest.",
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


def measured(
    measurement: Measurement, *, is_short: bool = False, is_recorded: bool = False
) -> Measured:
    """Runs it; what it says on standard error is shown as it comes."""
    command = measurement.short if is_short else measurement.command
    command = measurement.recorded if is_recorded else command
    begun_ns = clock.now_ns()
    ended = subprocess.run(
        [sys.executable, *command.split()], cwd=_CLONE, stdout=subprocess.PIPE, check=False
    )
    seconds = (clock.now_ns() - begun_ns) / 1e9
    text = ended.stdout.decode(errors="replace").strip()
    figures = _figures(text)
    return Measured(measurement, command, ended.returncode, seconds, figures, text[-500:])


def _figures(text: str) -> Any:
    """All of it, or else its last line; None: neither is JSON."""
    for part in (text, text.rpartition("\n")[2]):
        try:
            return json.loads(part)
        except ValueError:
            continue
    return None


# --- the page ------------------------------------------------------------------------------------


_NOT_YET = "Not measured yet: `make evidence ARGS='--only {name}'`."


def page(sections: Mapping[str, str]) -> str:
    """As Markdown. `sections`: by name, of what was measured, now or before."""
    lines = [
        "# Evidence",
        "",
        "What `make evidence` measured: each section when and on what it says. It is written by",
        "that command, and by nothing else; `ARGS='--only kills'` measures one of them anew.",
    ]
    there = [sections[one.name] for one in MEASUREMENTS if one.name in sections]
    if table := ages(there, _CLONE):
        lines += ["", *table]
    for measurement in MEASUREMENTS:
        not_yet = f"## {measurement.title}\n\n{_NOT_YET.format(name=measurement.name)}"
        lines += ["", sections.get(measurement.name, not_yet)]
    return "\n".join(lines) + "\n"


def section(one: Measured) -> str:
    form = "" if one.command == one.measurement.command else " in its SHORT form"
    if one.command == one.measurement.recorded:
        form = ", which measures nothing and shows what was recorded, by the versions below"
    met = "its bounds were met" if one.status == 0 else f"exit status {one.status}: NOT met"
    lines = [
        f"## {one.measurement.title}",
        "",
        one.measurement.about,
        "",
        f"`python {one.command}`{form}: {one.seconds:.0f} s, {met}.",
        "",
        *(f"- {what}: {value}" for what, value in machine().items()),
        "",
        *_shown(one),
    ]
    return "\n".join(lines)


def _shown(one: Measured) -> list[str]:
    if one.figures is None:
        return ["```", one.said, "```"]
    if not isinstance(one.figures, dict):
        return rendered(one.figures)
    left_out = one.measurement.left_out
    return rendered({key: value for key, value in one.figures.items() if key not in left_out})


def kept(text: str) -> dict[str, str]:
    """The sections of a page, by name, but those that were not measured yet."""
    found = {}
    for part in text.split("\n## ")[1:]:
        title, _, rest = part.partition("\n")
        for measurement in MEASUREMENTS:
            is_measured = _NOT_YET.format(name=measurement.name) not in rest
            if measurement.title == title and is_measured:
                found[measurement.name] = f"## {part.rstrip()}"
    return found


def changed(clone: Path = _CLONE) -> list[str]:
    """The files of a clone that are not as they were committed, but for what the measurements write
    themselves. A figure of changed files could not be measured again.
    """
    said = _git(clone, "status", "--porcelain", "--no-renames", "--untracked-files=no")
    return [line[3:] for line in said.splitlines() if line[3:] not in _WRITTEN]


def _git(clone: Path, *asked: str) -> str:
    """What it says; nothing where there is none, or no clone."""
    if shutil.which("git") is None:
        return ""
    said = subprocess.run(["git", *asked], cwd=clone, capture_output=True, text=True, check=False)
    return said.stdout.rstrip()


def machine() -> dict[str, str]:
    return {
        "date": _date(),
        "version": f"{__version__}, {_git(_CLONE, 'describe', '--always') or 'not from a clone'}",
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
            lines += [*([""] if lines else []), f"{_words(key)}:", "", *_table(rows)]
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
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[one.name for one in MEASUREMENTS],
        help="measure these; the others keep what the page says of them",
    )
    parser.add_argument(
        "--recorded",
        action="store_true",
        help="measure nothing: what keeps its figures shows them, the others keep their sections",
    )
    parser.add_argument(
        "--age",
        action="store_true",
        help="measure nothing: how much of the product has changed since each was measured",
    )
    parser.add_argument("--page", type=Path, default=PAGE, help="where to write (docs/evidence.md)")
    args = parser.parse_args(None if arguments is None else list(arguments))
    if args.page == PAGE and (files := changed()):
        parser.error(f"commit first, so that what is measured can be checked out: {files[0]}")
    console, statuses = Console(stderr=True), list[int]()
    if args.age:
        sections = kept(args.page.read_text(encoding="utf-8"))
        args.page.write_text(page(sections), encoding="utf-8")
        console.print(f"written: {args.page}")
        return 0
    for measurement in MEASUREMENTS:
        if args.only and measurement.name not in args.only:
            continue
        if args.recorded and not measurement.recorded:
            continue
        console.print(f"[bold]{measurement.title}[/bold]")
        one = measured(measurement, is_short=args.short, is_recorded=args.recorded)
        statuses.append(one.status)
        # After each: a run that is cut short keeps what it has.
        before = args.page.read_text(encoding="utf-8") if args.page.exists() else ""
        sections = {**kept(before), measurement.name: section(one)}
        args.page.write_text(page(sections), encoding="utf-8")
        console.print(f"written: {args.page}")
    return int(any(statuses))


if __name__ == "__main__":
    sys.exit(main())
