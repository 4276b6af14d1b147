"""From a client's `sent_ns` to the first pulse, over the real gateway and engine, in processes of
their own, on the real clock.

Owns: the two processes, the two ways of sending (one frame now and then; as many as go) and the
percentiles. Must not know: tables. No board is there, and no fake: `wall_engine.py` says why.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from bench.modelled import CURRENT_UA, ELECTRODES, WIDTH_US
from etd.client import Display, clock
from etd.client.telemetry import Telemetry
from etd.places import CONTROL, address_of
from etd.protocol import Scan

_HERE = Path(__file__).resolve().parent
_READY_WITHIN_NS = 20_000_000_000
_LIMIT_UA = 1_000
#: Idle frames are this far apart, so that the display has fallen silent in between.
_PAUSE_S = 0.04
_RATE_HZ = 60.0
_ONE = (CURRENT_UA, *(0,) * (ELECTRODES - 1))


@dataclass(frozen=True)
class LatencyFigures:
    """Of the frames that were shown, in us."""

    load: str
    sent: int
    shown: int
    p50_us: float
    p99_us: float
    p999_us: float
    #: Why the engine halted under it, if it did: then the figures are of the time before.
    halted: str = ""


def measure(samples: int, flood_s: float) -> tuple[LatencyFigures, LatencyFigures]:
    """Idle, then under a flood."""
    with (
        _processes() as address,
        Display(address=address, max_current_ua=_LIMIT_UA, width_us=WIDTH_US) as display,
    ):
        display.arm()
        display.hold_current(_ONE, seconds=0.4, width_us=WIDTH_US, rate_hz=_RATE_HZ)
        with display.telemetry("scan") as telemetry:
            idle = _idle(display, telemetry, samples)
            flooded = _flooded(display, telemetry, flood_s)
        halt = display.status().halt
    return idle, flooded if halt is None else replace(flooded, halted=halt.detail)


@contextmanager
def _processes() -> Iterator[str]:
    """The control address of a gateway that has found its engine."""
    with tempfile.TemporaryDirectory(prefix="etd-bench-") as temporary, ExitStack() as stack:
        folder = Path(temporary)
        stack.enter_context(
            _ended(
                subprocess.Popen(
                    [sys.executable, str(_HERE / "wall_engine.py"), str(folder)],
                    stdout=subprocess.PIPE,
                )
            )
        )
        part = ("run", "--part", "gateway", "--name", "bench", "--board", "fake")
        stack.enter_context(
            _ended(subprocess.Popen([sys.executable, "-m", "etd", *part, "--folder", str(folder)]))
        )
        _wait_for_engine(folder)
        yield address_of(folder)


@contextmanager
def _ended(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """The engine says that it is ready; both are asked to end."""
    with process:
        try:
            if process.stdout is not None:
                assert process.stdout.readline() == b"ready\n"
            yield
        finally:
            process.terminate()


def _wait_for_engine(folder: Path) -> None:
    deadline_ns = clock.now_ns() + _READY_WITHIN_NS
    while clock.now_ns() < deadline_ns:
        if (folder / CONTROL).exists():
            with Display(address=address_of(folder)) as display:
                if display.status().engine == "there":
                    return
        clock.sleep_s(0.05)
    raise TimeoutError("the gateway has found no engine")


def _idle(display: Display, telemetry: Telemetry, samples: int) -> LatencyFigures:
    """One frame of one pulse at a time."""
    sent_ns: dict[int, int] = {}
    found: dict[int, int] = {}
    for tag in range(samples):
        _send(display, sent_ns, tag)
        deadline_ns = clock.now_ns() + int(_PAUSE_S * 1e9)
        while (left_s := (deadline_ns - clock.now_ns()) / 1e9) > 0:
            _collect(telemetry, found, left_s)
    return _figures("idle", sent_ns, found)


def _flooded(display: Display, telemetry: Telemetry, flood_s: float) -> LatencyFigures:
    """As many frames as the client can send; newest wins."""
    sent_ns: dict[int, int] = {}
    found: dict[int, int] = {}
    tag, until_ns = 1_000_000, clock.now_ns() + int(flood_s * 1e9)
    while clock.now_ns() < until_ns:
        _send(display, sent_ns, tag)
        _collect(telemetry, found, 0.0)
        tag += 1
    _collect(telemetry, found, 0.2)
    load = f"flood of {len(sent_ns) / flood_s:.0f} frames/s"
    return _figures(load, sent_ns, found)


def _send(display: Display, sent_ns: dict[int, int], tag: int) -> None:
    sent_ns[tag] = clock.now_ns()
    display.stream_current(_ONE, width_us=WIDTH_US, rate_hz=_RATE_HZ, pulses=1, tag=tag)


def _collect(telemetry: Telemetry, first_ns: dict[int, int], timeout_s: float) -> None:
    """All reports that are there, or come within `timeout_s`: the first pulse of each frame."""
    while (item := telemetry.receive(timeout_s)) is not None:
        report = item[1]
        assert isinstance(report, Scan)
        for shown in report.shown:
            if shown.tag is not None and shown.first_ns is not None:
                first_ns[shown.tag] = shown.first_ns
        timeout_s = 0.0


def _figures(load: str, sent_ns: dict[int, int], first_ns: dict[int, int]) -> LatencyFigures:
    taken_us = sorted(
        (first_ns[tag] - sent_ns[tag]) / 1_000 for tag in first_ns.keys() & sent_ns.keys()
    )
    assert taken_us, "no frame was shown"
    return LatencyFigures(
        load,
        len(sent_ns),
        len(taken_us),
        _percentile(taken_us, 0.5),
        _percentile(taken_us, 0.99),
        _percentile(taken_us, 0.999),
    )


def _percentile(ordered: list[float], part: float) -> float:
    return ordered[round(part * (len(ordered) - 1))]
