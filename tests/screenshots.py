"""The pictures of a terminal in docs/plots, drawn by the program from reports of a real run.

    .venv/bin/python tests/screenshots.py            draws them again
    .venv/bin/python tests/screenshots.py --record   plays the demo on a fake board first, anew

Owns: the reports that are kept (`screens/demo.json`), the size of the terminal, and the frame
around it. Must not know: what is drawn in it (`etd.cli.live`).
"""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
from rich.console import Console
from rich.live import Live
from rich.terminal_theme import SVG_EXPORT_THEME

from etd.apps.demo_pattern import SweepingBar
from etd.apps.monitor import Monitor
from etd.cli.demo import title_of
from etd.cli.live import Drawn
from etd.cli.private_daemon import private_daemon
from etd.client import Display, clock
from etd.files.configuration import fake_config
from etd.protocol.facts import Endpoints
from etd.protocol.messages import (
    TELEMETRY_OF_TOPIC,
    Contact,
    HelloReply,
    Modelled,
    Scan,
    StateReport,
)

_TESTS = Path(__file__).parent
REPORTS = _TESTS / "screens" / "demo.json"
PLOTS = _TESTS.parent / "docs" / "plots"
#: Of a terminal, as it usually opens.
COLUMNS, ROWS = 80, 24
_BOARD, _ARRAY = "kajimoto-hv507", "grid-8x8"
#: How long the demo runs before the picture is taken, and between two frames.
_SECONDS, _FRAME_S = 2.4, 0.05

#: Rich's own has fonts from elsewhere; this one is complete in itself.
_FRAME = """\
<svg class="rich-terminal" viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg">
<style>
.{unique_id}-matrix {{ font-family: "DejaVu Sans Mono", Menlo, Consolas, monospace;
 font-size: {char_height}px; line-height: {line_height}px; }}
.{unique_id}-title {{ font-size: 18px; font-weight: bold; font-family: sans-serif; }}
{styles}
</style>
<defs>
<clipPath id="{unique_id}-clip-terminal">
<rect x="0" y="0" width="{terminal_width}" height="{terminal_height}" />
</clipPath>
{lines}
</defs>
{chrome}
<g transform="translate({terminal_x}, {terminal_y})" clip-path="url(#{unique_id}-clip-terminal)">
{backgrounds}
<g class="{unique_id}-matrix">
{matrix}
</g>
</g>
</svg>
"""


class Kept(msgspec.Struct, frozen=True):
    """What one moment of the demo was drawn from."""

    hello: HelloReply
    rate_hz: float
    reports: tuple[tuple[str, msgspec.Raw], ...]


def demo_svg() -> str:
    """The live picture of `etd demo`."""
    kept = msgspec.json.decode(REPORTS.read_bytes(), type=Kept)
    monitor = Monitor(kept.hello)
    for topic, report in kept.reports:
        monitor.hear(msgspec.json.decode(report, type=TELEMETRY_OF_TOPIC[topic]))  # type: ignore[index]
    console = Console(
        width=COLUMNS,
        height=ROWS,
        file=io.StringIO(),
        record=True,
        force_terminal=True,
        color_system="256",
        legacy_windows=False,
    )
    drawn = Drawn(monitor, Live(console=console, auto_refresh=False), title_of(kept.hello))
    console.print(drawn.picture(clock.now_ns(), kept.rate_hz))
    return console.export_svg(
        title="etd demo", theme=SVG_EXPORT_THEME, code_format=_FRAME, unique_id="etd"
    )


def record() -> None:
    """Play the demo on a fake board, and keep the reports of its last second."""
    loaded = fake_config(_BOARD, _ARRAY)
    with (
        private_daemon("demo", loaded) as address,
        Display(address=address, client="etd demo") as display,
        display.telemetry() as telemetry,
    ):
        facts = display.facts
        bar = SweepingBar(facts.array.x_mm, facts.array.y_mm)
        display.arm()
        heard: list[tuple[str, object]] = []
        rate_hz = 0.0
        for frame in range(int(_SECONDS / _FRAME_S)):
            rate_hz = display.show(bar.levels(frame * _FRAME_S), allow_slower=True).rate_hz
            until_ns = clock.now_ns() + int(_FRAME_S * 1e9)
            while (left_ns := until_ns - clock.now_ns()) > 0:
                item = telemetry.receive(left_ns / 1e9)
                if item is not None:
                    heard.append(item)
    reports = tuple((topic, msgspec.Raw(msgspec.json.encode(one))) for topic, one in needed(heard))
    nowhere = msgspec.structs.replace(facts, endpoints=Endpoints(frames="", telemetry=""))
    REPORTS.write_bytes(msgspec.json.encode(Kept(nowhere, rate_hz, reports)) + b"\n")


def needed(heard: Sequence[tuple[str, object]]) -> list[tuple[str, object]]:
    """The newest of each kind; of scans, those with the newest measurement of an electrode."""
    found: list[tuple[str, object]] = []
    known: set[int] = set()
    kinds: set[type] = set()
    for topic, report in reversed(heard):
        if isinstance(report, Scan):
            told = report.fired.contact
            told_of = {electrode for electrode, state in enumerate(told) if state is not None}
            if told_of <= known:
                continue
            known |= told_of
        elif not isinstance(report, StateReport | Contact | Modelled) or type(report) in kinds:
            continue
        kinds.add(type(report))
        found.append((topic, report))
    return found[::-1]


def main() -> None:
    if "--record" in sys.argv[1:]:
        record()
    (PLOTS / "demo.svg").write_text(demo_svg(), encoding="utf-8")


if __name__ == "__main__":
    main()
