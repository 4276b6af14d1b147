"""The progress of a simulated calibration: a bar on a terminal, otherwise a line an electrode.

Owns: both, on standard error. Must not know: procedures, daemons, where answers come from.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from etd.calibrate.answers import Presentation
from etd.calibrate.progress import Progress
from etd.cli.calibrate_screen import count_of, to_come
from etd.cli.terminal import check_rich

if TYPE_CHECKING:
    from rich.progress import Progress as Bar
    from rich.progress import TaskID
    from typing_extensions import Self

#: An electrode takes half a minute: the time left is estimated from the last twenty.
_REMEMBERED_S = 600.0


class Watch:
    """`progress` is read, never changed. A context manager.

    Raises, when made: HardwareMissing on a terminal without rich.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._bar: Bar | None = None
        self._task: TaskID | None = None
        if sys.stderr.isatty():
            check_rich()
            self._bar = _bar()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def begin(self, to_do: int) -> None:
        """Before the first presentation, during the soft start; `to_do`: so many electrodes."""
        print(to_come(self._progress, to_do), file=sys.stderr, flush=True)
        if self._bar is not None:
            self._task = self._bar.add_task("", total=self._progress.conditions.electrodes)
            self._draw()
            self._bar.start()

    def presented(self, _: Presentation) -> None:
        self._draw()

    def found(self) -> None:
        if self._bar is None:
            print(count_of(self._progress), file=sys.stderr, flush=True)
        self._draw()

    def advise(self, advice: str) -> None:
        print(advice, file=sys.stderr, flush=True)

    def _draw(self) -> None:
        if self._bar is None or self._task is None:
            return
        self._bar.update(
            self._task,
            completed=len(self._progress.found),
            description=count_of(self._progress),
            refresh=True,
        )


def _bar() -> Bar:
    """Drawn after an event, about once a second: no thread runs beside the pulses."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    return Bar(
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TimeElapsedColumn(),
        TextColumn("to go"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        auto_refresh=False,
        speed_estimate_period=_REMEMBERED_S,
    )
