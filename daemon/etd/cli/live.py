"""The live picture: the array as it fires, and a line of state beneath; plain lines elsewhere.

Owns: drawing on the terminal, and how often. Must not know: what the reports mean (apps.monitor).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from etd.apps.monitor import Monitor
from etd.apps.panel import CONTACT_SIGNS, Panel
from etd.apps.picture import Picture
from etd.cli.terminal import check_rich, is_terminal
from etd.client import clock
from etd.protocol.text import shown

if TYPE_CHECKING:
    from rich.console import Group
    from rich.live import Live
    from rich.text import Text

_DRAW_NS = 50_000_000
#: State is reported each second.
_OLD_NS = 2_000_000_000
#: Between panels.
_GAP = 3
#: What is drawn first where there is no room for all panels.
_ORDER = (
    "delivered",
    "contact",
    "felt (modelled)",
    "laws: + gave, - took",
    "wanted",
    "resistance",
    "pressure",
)
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
            print(shown(self._monitor.line(rate_hz)), flush=True)


class Drawn:
    """The picture, drawn over itself: the state at the top, then as many panels as there is room
    for, in their order of importance.
    """

    def __init__(self, monitor: Monitor, live: Live, title: str) -> None:
        array = monitor.facts.array
        self._monitor = monitor
        self._live = live
        self._title = title
        cells = Picture(array.x_mm, array.y_mm).cells()
        self._places = sorted(zip(cells, range(len(cells)), strict=True))
        self._rows = max(row for row, _ in cells) + 1
        self._width = 2 * (max(column for _, column in cells) + 1)
        self._due_ns = 0
        #: How many reports were heard when it was drawn last, and when the newest came.
        self._reports = 0
        self._heard_ns = clock.now_ns()

    def draw(self, rate_hz: float | None = None) -> None:
        """Call it once all reports that have come are heard: what is drawn is the newest."""
        now_ns = clock.now_ns()
        if self._monitor.reports != self._reports:
            self._reports, self._heard_ns = self._monitor.reports, now_ns
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + _DRAW_NS
            self._live.update(self.picture(now_ns, rate_hz), refresh=True)

    def picture(self, now_ns: int, rate_hz: float | None) -> Group:
        from rich.columns import Columns
        from rich.console import Group
        from rich.text import Text

        console = self._live.console
        state = Text(
            shown(self._monitor.line(rate_hz)), style=_ALARM if self._is_alarming() else "bold"
        )
        head = [Text(shown(self._title), overflow="ellipsis", no_wrap=True), state]
        age_ns = now_ns - self._heard_ns
        if age_ns >= _OLD_NS:
            head.append(Text(f"no report for {age_ns / 1e9:.0f} s: this is old", style=_ALARM))
        room = console.height - sum(len(text.wrap(console, console.width)) for text in head)
        signs = "   ".join(f"{sign} {kind}" for kind, sign in CONTACT_SIGNS.items())
        legend = Text(f"contact: {signs}", style="grey50")
        legend_rows = len(legend.wrap(console, console.width)) + 1
        foot = [legend] if room - legend_rows > self._rows else []
        if foot:
            room -= legend_rows
        fitting, hidden = self._that_fit(console.width, room)
        if foot and hidden:
            what = f"no room for {', '.join(hidden)}: enlarge the terminal"
            foot.append(Text(what, style="grey50", overflow="ellipsis", no_wrap=True))
        panels = Columns([self._panel(panel) for panel in fitting], padding=(0, _GAP))
        return Group(*head, panels, *foot)

    def _is_alarming(self) -> bool:
        return self._monitor.halt is not None or self._monitor.state.startswith("engine")

    def _that_fit(self, columns: int, rows: int) -> tuple[list[Panel], list[str]]:
        """The panels to draw, and the names of those for which there is no room."""
        panels = sorted(self._monitor.panels(), key=_importance)
        widest = max(self._width, *(len(panel.title) for panel in panels))
        a_row = max(1, (columns + _GAP) // (widest + _GAP))
        fitting = max(1, a_row * (rows // (self._rows + 1)))
        return panels[:fitting], [panel.title for panel in panels[fitting:]]

    def _panel(self, panel: Panel) -> Text:
        from rich.text import Text

        text = Text(f"{panel.title.ljust(self._width)}\n", no_wrap=True)
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
        print(shown(title), flush=True)
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


def _importance(panel: Panel) -> int:
    return _ORDER.index(panel.title)
