"""From a client's `sent_ns` to the first pulse, over the real gateway and engine, in processes of
their own, on the real clock.

Owns: the two processes, the two ways of sending (one frame now and then; as many as go) and the
percentiles. Must not know: tables. No board is there, and no fake: `wall_engine.py` says why.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench.modelled import CURRENT_UA, ELECTRODES, WIDTH_US
from etd.client import Display, clock
from etd.client.telemetry import Telemetry
from etd.files.paths import CONTROL, address_of
from etd.protocol.errors import Refused
from etd.protocol.messages import Scan

_HERE = Path(__file__).resolve().parent
_READY_WITHIN_NS = 20_000_000_000
_LIMIT_UA = 1_000
#: Idle frames are this far apart, so that the display has fallen silent in between.
_PAUSE_S = 0.04
_IDLE_ROUND, _IDLE_ROUNDS = 50, 20
_FLOOD_ROUND_S, _FLOOD_ROUNDS = 1.0, 10
_OPENING_S = 0.4
#: On a busy machine a message may be overdue, by what the machine takes from it.
_OPENINGS = 20
#: Reports of the last frames of a round come within this time.
_LATE_S = 0.1
_RATE_HZ = 60.0
_ONE = (CURRENT_UA, *(0,) * (ELECTRODES - 1))


@dataclass(frozen=True)
class LatencyFigures:
    """Of the frames that were shown, in us. `cut_short`: rounds at whose end the display was no
    longer armed (a machine so busy that a part was silent, or a message overdue), and why.
    """

    load: str
    sent: int
    shown: int
    p50_us: float
    p99_us: float
    p999_us: float
    cut_short: int
    why: str


def measure(is_quick: bool) -> tuple[LatencyFigures, LatencyFigures]:
    """Idle, then under a flood."""
    with (
        _processes() as address,
        Display(address=address, max_current_ua=_LIMIT_UA, width_us=WIDTH_US) as display,
    ):
        rounds = (1, 1) if is_quick else (_IDLE_ROUNDS, _FLOOD_ROUNDS)
        idle = _Rounds(display, _idle).run(rounds[0])
        flooded = _Rounds(display, _flood).run(rounds[1])
    rate = flooded.sent / (rounds[1] * _FLOOD_ROUND_S)
    return idle.figures("idle"), flooded.figures(f"flood of {rate:.0f} frames/s")


@contextmanager
def _processes() -> Iterator[str]:
    """The control address of a gateway that has found its engine."""
    with tempfile.TemporaryDirectory(prefix="etd-bench-") as temporary, ExitStack() as stack:
        folder = Path(temporary)
        stack.enter_context(
            ended(
                subprocess.Popen(
                    [sys.executable, str(_HERE / "wall_engine.py"), str(folder)],
                    stdout=subprocess.PIPE,
                )
            )
        )
        part = ("run", "--part", "gateway", "--name", "bench", "--board", "fake")
        stack.enter_context(
            ended(subprocess.Popen([sys.executable, "-m", "etd", *part, "--folder", str(folder)]))
        )
        wait_for_engine(folder)
        yield address_of(folder)


@contextmanager
def ended(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """The engine says that it is ready; both are asked to end."""
    with process:
        try:
            if process.stdout is not None:
                assert process.stdout.readline() == b"ready\n"
            yield
        finally:
            process.terminate()


def wait_for_engine(folder: Path) -> None:
    deadline_ns = clock.now_ns() + _READY_WITHIN_NS
    while clock.now_ns() < deadline_ns:
        if (folder / CONTROL).exists():
            with Display(address=address_of(folder)) as display:
                if display.status().engine == "there":
                    return
        clock.sleep_s(0.05)
    raise TimeoutError("the gateway has found no engine")


class _Rounds:
    """One way of sending, in rounds that each begin armed and open."""

    def __init__(self, display: Display, send_round: Callable[[_Rounds, Telemetry], None]) -> None:
        self.display = display
        self._send_round = send_round
        self._sent_ns: dict[int, int] = {}
        self._first_ns: dict[int, int] = {}
        self._cut_short: list[str] = []

    @property
    def sent(self) -> int:
        return len(self._sent_ns)

    def run(self, rounds: int) -> _Rounds:
        for _ in range(rounds):
            self._open_up()
            with self.display.telemetry("scan") as telemetry:
                self._send_round(self, telemetry)
                self.collect(telemetry, _LATE_S)
            status = self.display.status()
            if status.state != "ARMED":
                self._cut_short.append(status.last_disarm or status.state)
        return self

    def _open_up(self) -> None:
        """Whatever was, it is armed now. On a busy machine that may be cut short as well."""
        for left in reversed(range(_OPENINGS)):
            try:
                self._try_to_open_up()
                break
            except Refused as refusal:
                if not left:
                    raise
                self._cut_short.append(refusal.reason)

    def _try_to_open_up(self) -> None:
        status = self.display.status()
        if status.halt is not None:
            self.display.clear()
        if status.state != "ARMED":
            self.display.arm()
        self.display.hold_current(_ONE, seconds=_OPENING_S, width_us=WIDTH_US, rate_hz=_RATE_HZ)

    def send(self) -> None:
        """One frame of one pulse, marked by how many there were before."""
        tag = len(self._sent_ns)
        self._sent_ns[tag] = clock.now_ns()
        self.display.stream_current(_ONE, width_us=WIDTH_US, rate_hz=_RATE_HZ, pulses=1, tag=tag)

    def collect(self, telemetry: Telemetry, timeout_s: float) -> None:
        """The first pulse of each frame, from all reports that come within `timeout_s`."""
        while (item := telemetry.receive(timeout_s)) is not None:
            report = item[1]
            assert isinstance(report, Scan)
            for shown in report.shown:
                if shown.tag is not None and shown.first_ns is not None:
                    self._first_ns[shown.tag] = shown.first_ns
            timeout_s = 0.0

    def figures(self, load: str) -> LatencyFigures:
        taken_us = sorted(
            (first_ns - self._sent_ns[tag]) / 1_000 for tag, first_ns in self._first_ns.items()
        )
        assert taken_us, "no frame was shown in any round: this machine is too busy to measure on"
        p50_us, p99_us, p999_us = (_percentile(taken_us, part) for part in (0.5, 0.99, 0.999))
        why = "; ".join(sorted(set(self._cut_short)))
        return LatencyFigures(
            load, self.sent, len(taken_us), p50_us, p99_us, p999_us, len(self._cut_short), why
        )


def _idle(rounds: _Rounds, telemetry: Telemetry) -> None:
    """One frame at a time."""
    for _ in range(_IDLE_ROUND):
        rounds.send()
        deadline_ns = clock.now_ns() + int(_PAUSE_S * 1e9)
        while (left_s := (deadline_ns - clock.now_ns()) / 1e9) > 0:
            rounds.collect(telemetry, left_s)


def _flood(rounds: _Rounds, telemetry: Telemetry) -> None:
    """As many frames as the client can send; newest wins."""
    until_ns = clock.now_ns() + int(_FLOOD_ROUND_S * 1e9)
    while clock.now_ns() < until_ns:
        rounds.send()
        rounds.collect(telemetry, 0.0)


def _percentile(ordered: list[float], part: float) -> float:
    return ordered[round(part * (len(ordered) - 1))]
