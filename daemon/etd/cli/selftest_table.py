"""The printed self-test: a line for each check, in colors on a terminal.

Owns: drawing. Must not know: what is checked.
"""

from __future__ import annotations

import importlib.util
import sys

from etd.cli.terminal import is_terminal
from etd.selftest.report import Check
from etd.selftest.run import STAGES

_COLORS = {"pass": "green", "fail": "bold red", "skip": "yellow", "absent": "dim"}


class Table:
    """Prints a line for each check."""

    def __init__(self, has_colors: bool) -> None:
        self._has_colors = has_colors

    def stage(self, name: str, what: str) -> None:
        number = [stage for stage, _ in STAGES].index(name) + 1
        self._print(f"{number}/{len(STAGES)} {name}: {what}", "bold")

    def check(self, check: Check) -> None:
        expected = f"  ({check.expected})" if check.expected else ""
        line = f"  {check.result:6} {check.name:25} {check.measured}{expected}"
        self._print(line, _COLORS[check.result])

    def ask(self, what: str) -> None:
        self._print(f"  -> {what}", "bold cyan")

    def _print(self, line: str, style: str) -> None:
        if not self._has_colors:
            print(line, flush=True)
            return
        from rich.console import Console

        Console().print(line, style=style, markup=False, highlight=False)


class Quiet:
    """Prints only instructions to the operator, so that a program can read the answer."""

    def stage(self, name: str, what: str) -> None:
        pass

    def check(self, check: Check) -> None:
        pass

    def ask(self, what: str) -> None:
        print(what, file=sys.stderr, flush=True)


def table_of(is_quiet: bool) -> Table | Quiet:
    """Colors need a terminal, and rich."""
    if is_quiet:
        return Quiet()
    return Table(has_colors=is_terminal() and importlib.util.find_spec("rich") is not None)
