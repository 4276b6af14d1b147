"""`etd demo`: a moving pattern on a fake board, through real processes and sockets.

Owns: the loop that sends frames and draws. Must not know: the pattern (apps.demo_pattern), the
picture (live). It starts its own daemon; no option names a running one.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from etd.apps.demo_pattern import SweepingBar
from etd.apps.monitor import Monitor
from etd.cli import Terminated, options
from etd.cli.live import Drawn, Plain, picture_of
from etd.cli.private_daemon import answer_within_s, private_daemon
from etd.client import Display, clock
from etd.client.telemetry import Telemetry
from etd.files.configuration import fake_config
from etd.protocol.errors import Refused
from etd.protocol.messages import FrameReply, HelloReply

HELP = "show a moving pattern on a fake board, without hardware"
EPILOG = """
examples:
  etd demo
  etd demo --seconds 10 --array hexagon-61
  etd demo --board fake:feetthrough-relay --trace bus.jsonl

`etd monitor --help` explains the picture; what is felt is modelled. The demo starts a daemon and
ends it; `etd run --board fake` runs one that stays.
"""
#: The frame period.
_FRAME_NS = 50_000_000
#: The current and width of level 1 on an array without a calibration of the fake's body.
_CURRENT_UA, _WIDTH_US = 2_000, 100
_ARM_WITHIN_S = 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_seconds(parser)
    parser.add_argument(
        "--board",
        type=options.any_board_faked,
        default=options.FakeBoard(None),
        metavar="[fake:]BOARD",
        help="a shipped board, always as a fake (default: kajimoto-hv507)",
    )
    parser.add_argument("--array", help="a shipped array, or a file (eTactileKit's layouts too)")
    parser.add_argument("--trace", type=Path, metavar="FILE", help="record the fake's buses")
    options.add_timeout_factor(parser, f"default: {options.PRIVATE_TIMEOUT_FACTOR}")


def run(args: argparse.Namespace) -> int:
    """Ends with `--seconds` or Ctrl-C, status 0. Raises: FileError, PartEnded, Refused,
    Terminated.
    """
    loaded = fake_config(args.board.board, args.array)
    has_calibration = loaded.config.default_calibration is not None
    with (
        private_daemon("demo", loaded, args.trace, timeout_factor=args.timeout_factor) as address,
        _display(args, address, has_calibration) as display,
    ):
        demo = Demo(display, has_calibration)
        try:
            demo.run(args.seconds)
        except Terminated:
            raise
        except KeyboardInterrupt:
            pass  # as `--seconds` ends it
        print(demo.summary())
    return 0


def _display(args: argparse.Namespace, address: str, has_calibration: bool) -> Display:
    current_ua, width_us = (None, None) if has_calibration else (_CURRENT_UA, _WIDTH_US)
    return Display(
        address=address,
        client="etd demo",
        max_current_ua=current_ua,
        width_us=width_us,
        timeout_s=answer_within_s(args.timeout_factor),
    )


def title_of(facts: HelloReply) -> str:
    """Above the picture."""
    return (
        f"etd demo (backend: {facts.board.backend}; {facts.board.name}, {facts.array.name}):"
        " a bar sweeps across the skin; Ctrl-C ends it"
    )


class Demo:
    """Sends a frame every 50 ms, and draws the telemetry; counts frames that arrive too late."""

    def __init__(self, display: Display, has_calibration: bool) -> None:
        facts = display.facts
        self._display = display
        self._has_calibration = has_calibration
        self._bar = SweepingBar(facts.array.x_mm, facts.array.y_mm)
        self._monitor = Monitor(facts)
        self._rate_hz: float | None = None
        self._begun_ns = clock.now_ns()
        self._frames = 0
        self._late = 0

    def run(self, seconds: float | None) -> None:
        """Run for `seconds`, or until Ctrl-C."""
        title = title_of(self._display.facts)
        with self._display.telemetry() as reports, picture_of(self._monitor, title) as picture:
            self._display.arm(_ARM_WITHIN_S)
            self._begun_ns = clock.now_ns()
            while seconds is None or self._seconds() < seconds:
                self._show(self._bar.levels(self._seconds()))
                self._frames += 1
                self._listen(reports, picture, self._begun_ns + self._frames * _FRAME_NS)

    def summary(self) -> str:
        status = self._display.status()
        pulses = status.counters.get("pulses", 0)
        late = f" ({self._late} too late to be shown)" if self._late else ""
        return (
            f"{self._frames} frames{late} and {pulses} pulses in {self._seconds():.1f} s on the"
            f" fake {self._display.facts.board.name}; ceiling {status.ceiling_ua} uA"
        )

    def _show(self, levels: list[float]) -> None:
        """Raises: Refused, except for a frame that arrived too late."""
        try:
            self._rate_hz = self._shown(levels).rate_hz
        except Refused as refusal:
            if refusal.code != "expired":
                raise
            self._late += 1

    def _shown(self, levels: list[float]) -> FrameReply:
        if self._has_calibration:
            return self._display.show(levels, allow_slower=True)
        currents_ua = [int(level * _CURRENT_UA) for level in levels]
        return self._display.show_current(currents_ua, width_us=_WIDTH_US, allow_slower=True)

    def _listen(self, reports: Telemetry, picture: Plain | Drawn, until_ns: int) -> None:
        """All that has arrived is heard before it is drawn, and drawn even where the next frame is
        late already.
        """
        wait_s = 0.0
        while True:
            item = reports.receive(wait_s)
            if item is not None:
                self._monitor.hear(item[1])
                wait_s = 0.0
                continue
            picture.draw(self._rate_hz)
            left_ns = until_ns - clock.now_ns()
            if left_ns <= 0:
                return
            wait_s = left_ns / 1e9

    def _seconds(self) -> float:
        return (clock.now_ns() - self._begun_ns) / 1e9
