"""`etd monitor`: what the daemon reports, live.

Owns: which of the three forms it takes: picture, lines, JSON lines. Must not know: what the
reports mean.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator

import msgspec

from etd.apps.monitor import Monitor
from etd.cli import options
from etd.cli.keys import keys_of
from etd.cli.live import picture_of
from etd.cli.running import display_of
from etd.client import Display, clock
from etd.client.telemetry import Item, Telemetry
from etd.protocol.errors import HELD_UP, DaemonGone, Refused

HELP = "show live what is fired, and what limits it"
EPILOG = """
examples:
  etd monitor                        a live picture of the array
  etd monitor | tee session.txt      a line a second
  etd monitor --json --seconds 10    all telemetry, as JSON lines {"topic", "report"}

The picture has panels for the wanted current, the delivered current, the resistance (brighter:
lower) and the contact; on a fake board also for what a modelled body feels, with pain in red.
Where stabilizers run, a panel shows which gave (+) and which took (-), brighter the more, and the
line says it as factors on the charge ("laws x0.71-1.30"), before limits.
"?" means not known, or older than a second. The line below shows the state (`etd status` shows
more), and the limits that clamped a current (names as in docs/protocol.md).

"said x0.81" is what the person's answers on the strength left of the current (display.felt).
The key - says too strong for them: all electrodes get 5 % less at once. Press again for more:
within half a minute 20 % less, then half. It can only lower, since the monitor does not hold the
lease. "said" is above x1 only where the body site and the calibration let answers raise. The key is
no stop: that is `etd stop`. Otherwise the command only reads telemetry.
"""
#: The key for it.
TOO_STRONG = "-"
_TURN_S = 0.05
#: `state` comes each second: after this long without it the daemon is gone.
_SILENT_S = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_daemon(parser)
    options.add_seconds(parser)
    options.add_json(parser, "JSON lines")


def run(args: argparse.Namespace) -> int:
    """Ends with `--seconds` or Ctrl-C, status 0. Raises: DaemonGone, Refused (`engine_gone`)."""
    end_ns = None if args.seconds is None else clock.now_ns() + int(args.seconds * 1e9)
    with (
        contextlib.suppress(KeyboardInterrupt),
        display_of(args, "etd monitor") as display,
        display.telemetry() as reports,
        keys_of(sys.stdin) as pressed,
    ):
        heard = _heard(reports, end_ns, display.address)
        if args.json:
            _print_lines(heard)
        else:
            draw(display, heard, pressed)
    return 0


def _heard(reports: Telemetry, end_ns: int | None, address: str) -> Iterator[Item | None]:
    """The reports, and None whenever all that have come are heard. Raises: DaemonGone, when no
    report comes.
    """
    heard_ns, wait_s = clock.now_ns(), 0.0
    while end_ns is None or clock.now_ns() < end_ns:
        item = reports.receive(wait_s)
        if item is not None:
            heard_ns, wait_s = clock.now_ns(), 0.0
        elif clock.now_ns() - heard_ns > _SILENT_S * 1e9:
            raise DaemonGone(address, f"no telemetry for {_SILENT_S:g} s", HELD_UP)
        else:
            wait_s = _TURN_S
        yield item


def _print_lines(heard: Iterator[Item | None]) -> None:
    for item in heard:
        if item is not None:
            line = {"topic": item[0], "report": item[1]}
            print(msgspec.json.encode(line).decode(), flush=True)


def draw(display: Display, heard: Iterator[Item | None], pressed: Callable[[], str]) -> None:
    """`heard`: reports, and None where there is none for now. `pressed`: the keys since it was
    called last.
    """
    facts = display.facts
    monitor = Monitor(facts, key=TOO_STRONG if sys.stdin.isatty() else "")
    title = f"etd {facts.name} (backend: {facts.board.backend}; {facts.board.name})"
    with picture_of(monitor, title) as picture:
        for item in heard:
            # Before each report too: a press must not wait for a pause between reports.
            for _ in range(pressed().count(TOO_STRONG)):
                _lower(display, monitor)
            if item is not None:
                monitor.hear(item[1])
            else:
                picture.draw()


def _lower(display: Display, monitor: Monitor) -> None:
    """Who watches can lower what is felt, and not raise it."""
    try:
        display.felt("too_strong")
    except Refused as refusal:
        monitor.refused = str(refusal)
    else:
        monitor.refused = ""
