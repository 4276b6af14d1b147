"""The live picture: the array as it fires, and a line of state beneath; plain lines elsewhere.

Owns: drawing on the terminal, and how often. Must not know: what the reports mean (apps.monitor).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from etd.apps.monitor import CONTACT_SIGNS, Monitor, Panel
from etd.apps.picture import Picture
from etd.cli.terminal import check_rich, is_terminal
from etd.client import clock

if TYPE_CHECKING:
    from rich.console import Group
    from rich.live import Live
    from rich.text import Text

_DRAW_NS = 50_000_000
_LINE_NS = 1_000_000_000
#: From dark to bright, in the terminal's 256 colors.
_COLORS = ("grey30", "dark_orange3", "dark_orange", "orange1", "gold1", "bright_white")
_ALARM = "bold red"
#: Lower values are drawn as zero.
_DARK = 0.01


class Plain:
    """A line once a second."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._due_ns = clock.now_ns() + _LINE_NS

    def draw(self, rate_hz: float | None = None) -> None:
        now_ns = clock.now_ns()
        if now_ns >= self._due_ns:
            self._due_ns += _LINE_NS
            print(self._monitor.line(rate_hz), flush=True)


class Drawn:
    """The picture, drawn over itself."""

    def __init__(self, monitor: Monitor, live: Live, title: str) -> None:
        array = monitor.facts.array
        self._monitor = monitor
        self._live = live
        self._title = title
        cells = Picture(array.x_mm, array.y_mm).cells()
        self._places = sorted(zip(cells, range(len(cells)), strict=True))
        self._due_ns = 0

    def draw(self, rate_hz: float | None = None) -> None:
        now_ns = clock.now_ns()
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + _DRAW_NS
            self._live.update(self._picture_now(rate_hz), refresh=True)

    def _picture_now(self, rate_hz: float | None) -> Group:
        from rich.columns import Columns
        from rich.console import Group
        from rich.text import Text

        panels = Columns([self._panel(panel) for panel in self._monitor.panels()], padding=(0, 3))
        contact = "   ".join(f"{sign} {kind}" for kind, sign in CONTACT_SIGNS.items())
        return Group(
            Text(f"{self._title}\n"),
            panels,
            Text(f"\ncontact: {contact}", style="grey50"),
            Text(f"{self._monitor.line(rate_hz)}\n"),
        )

    def _panel(self, panel: Panel) -> Text:
        from rich.text import Text

        text = Text(f"{panel.title}\n", no_wrap=True)
        row_now, column_now = 0, 0
        for (row, column), electrode in self._places:
            if row > row_now:
                text.append("\n" * (row - row_now))
                row_now, column_now = row, 0
            text.append("  " * (column - column_now))
            text.append(*_cell(panel, electrode))
            column_now = column + 1
        return text


@contextmanager
def picture_of(monitor: Monitor, title: str) -> Iterator[Plain | Drawn]:
    """Call `draw` as often as you like. Raises: HardwareMissing without rich on a terminal."""
    if not is_terminal():
        print(title, flush=True)
        yield Plain(monitor)
        return
    check_rich()
    from rich.live import Live

    with Live(auto_refresh=False) as live:
        yield Drawn(monitor, live, title)


def _cell(panel: Panel, electrode: int) -> tuple[str, str]:
    """Two characters, and their style."""
    bright = panel.bright[electrode]
    style = _ALARM if electrode in panel.alarming else _color(bright or 0.0)
    if panel.signs is not None:
        return f"{panel.signs[electrode]} ", style
    if bright is None:
        return "? ", style
    return ("██" if bright > _DARK else "··"), style


def _color(bright: float) -> str:
    return _COLORS[min(len(_COLORS) - 1, round(bright * (len(_COLORS) - 1) + 0.3))]
