"""The terminal: whether there is one, progress on it, and what to install to draw on it.

Owns: every use of rich that more than one verb needs. Must not know: what is shown.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from etd.cli.extras import check_installed


def is_terminal() -> bool:
    return sys.stdout.isatty()


def check_rich() -> None:
    """Raises: PackageMissing, with what to install, before anything is begun."""
    check_installed("rich")


@contextmanager
def progress_of(total: int, is_quiet: bool) -> Iterator[Callable[[int], None]]:
    """A function to call with the number done: a bar on a terminal, otherwise a line for the first
    and for each tenth; nothing when quiet.
    """
    if is_quiet:
        yield lambda _: None
    elif is_terminal():
        check_rich()
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

        columns = ("frames", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, transient=True) as progress:
            task = progress.add_task("frames", total=total)
            yield lambda done: progress.update(task, completed=done)
    else:
        yield lambda done: _line(done, total)


def _line(done: int, total: int) -> None:
    if done == 1 or done * 10 // total != (done - 1) * 10 // total:
        print(f"{done} of {total} frames", flush=True)
