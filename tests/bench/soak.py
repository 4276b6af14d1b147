"""`make soak`: a daemon that plays for an hour beside a load, and a thousand that start and end.

Owns: the hour (frames of a moving dot, a new client every second, a hog at nice 19), what is looked
at meanwhile (memory and descriptors of both parts, how long a frame and a status take,
what the daemon counts), the restarts, and what of it must hold: exit status 1 where it does not.
Must not know: how the daemon works.

The daemon is `etd run --board fake:reference-hv507`, as installed beside this file: its board has a
heartbeat, whose gate takes the supply away for good when a beat is missed, and the engine halts.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

from rich.console import Console  # noqa: E402
from rich.progress import Progress  # noqa: E402

from bench.run import Bound, at_most  # noqa: E402
from etd.client import Display, clock  # noqa: E402
from etd.files.paths import CONTROL, address_of  # noqa: E402
from etd.protocol.errors import EtdError  # noqa: E402

_BOARD, _CALIBRATION = "fake:reference-hv507", "fake-fingertip"
_FRAMES_HZ = 30.0
_READY_WITHIN_S, _ENDS_WITHIN_S = 30.0, 10.0
#: What was begun with counts as warm-up: caches and pools fill.
_WARM_PART = 0.25
_MOST_GROWTH_MB, _MOST_MORE_DESCRIPTORS = 5.0, 2
_HOG = "while True: pass"


@dataclass
class Look:
    """At one second: megabytes and descriptors of all its processes together, and times in ms."""

    at_s: float
    mb: float
    descriptors: int
    frame_ms: float
    status_ms: float


@dataclass
class Soaked:
    """What was found; `counters` are the daemon's own at the end."""

    seconds: float
    looks: list[Look] = field(default_factory=list)
    counters: dict[str, int] = field(default_factory=dict)
    #: Refusals and losses, in words.
    refused: list[str] = field(default_factory=list)
    #: Why it halted. It stays so: nobody clears it.
    halt: str | None = None
    state: str = ""

    def after_warm_up(self) -> tuple[list[Look], list[Look]]:
        """The first and the last quarter of what follows the warm-up."""
        warm = self.looks[int(len(self.looks) * _WARM_PART) :]
        part = max(1, len(warm) // 4)
        return warm[:part], warm[-part:]


@dataclass
class Restarted:
    """Milliseconds to the first reply of an engine, and from the request to end to the end."""

    started_ms: list[float] = field(default_factory=list)
    ended_ms: list[float] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)


# --- a daemon ------------------------------------------------------------------------------------


@contextmanager
def _process(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(_ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()


@contextmanager
def _daemon(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    words = (sys.executable, "-m", "etd", "run", "--board", _BOARD, "--folder", str(folder))
    with _process(*words) as process:
        _wait_for_engine(folder)
        yield process


def _wait_for_engine(folder: Path) -> None:
    until_ns = clock.now_ns() + int(_READY_WITHIN_S * 1e9)
    while clock.now_ns() < until_ns:
        if (folder / CONTROL).exists() and _engine_is_there(folder):
            return
        clock.sleep_s(0.02)
    raise TimeoutError(f"no engine within {_READY_WITHIN_S:g} s")


def _engine_is_there(folder: Path) -> bool:
    try:
        with Display(address=address_of(folder)) as display:
            return display.status().engine == "there"
    except EtdError:
        return False


def _family(pid: int) -> list[int]:
    """It and all that it started."""
    listed = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [pid, *(each for child in map(int, listed) for each in _family(child))]


def _taken(pid: int) -> tuple[float, int]:
    """Megabytes and descriptors, of its whole family."""
    family = _family(pid)
    pages = sum(int(Path(f"/proc/{each}/statm").read_text().split()[1]) for each in family)
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6, sum(map(_descriptors, family))


def _descriptors(pid: int) -> int:
    """An engine's may be listed by root alone. Linux 6.2 and newer tell everybody how many."""
    folder = f"/proc/{pid}/fd"
    return os.stat(folder).st_size or len(os.listdir(folder))


# --- the hour ------------------------------------------------------------------------------------


def soak(seconds: float, progress: Progress) -> Soaked:
    """A moving dot, thirty frames a second, beside a hog."""
    found, task = Soaked(seconds), progress.add_task("playing", total=seconds)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="etd-soak-")))
        daemon = stack.enter_context(_daemon(folder))
        stack.enter_context(_process("nice", "-n", "19", sys.executable, "-c", _HOG))
        address = address_of(folder)
        display = stack.enter_context(Display(address=address, calibration=_CALIBRATION))
        display.arm(open_to=0.5)
        begun_ns = next_ns = clock.now_ns()
        number, looked_s, slowest_ms = 0, 0.0, 0.0
        while (at_s := (clock.now_ns() - begun_ns) / 1e9) < seconds:
            slowest_ms = max(slowest_ms, _frame_ms(display, number, found))
            number += 1
            if at_s - looked_s >= 1.0:
                looked_s = at_s
                mb, descriptors = _taken(daemon.pid)
                found.looks.append(Look(at_s, mb, descriptors, slowest_ms, _status_ms(address)))
                slowest_ms = 0.0
                progress.update(task, completed=at_s)
            next_ns = max(next_ns + int(1e9 / _FRAMES_HZ), clock.now_ns() - int(1e9))
            clock.sleep_s(max(0.0, (next_ns - clock.now_ns()) / 1e9))
        status = display.status()
        found.state, found.counters = status.state, dict(status.counters)
        found.halt = None if status.halt is None else f"{status.halt.source}: {status.halt.detail}"
    return found


def _frame_ms(display: Display, number: int, found: Soaked) -> float:
    levels = [0.0] * display.electrodes
    levels[number % display.electrodes] = 0.5
    begun_ns = clock.now_ns()
    try:
        display.show(levels, allow_slower=True)
    except EtdError as error:
        found.refused.append(str(error))
    return (clock.now_ns() - begun_ns) / 1e6


def _status_ms(address: str) -> float:
    """By a client that has just come."""
    begun_ns = clock.now_ns()
    with Display(address=address) as display:
        display.status()
    return (clock.now_ns() - begun_ns) / 1e6


# --- restarts ------------------------------------------------------------------------------------


def restart(times: int, progress: Progress) -> Restarted:
    """In one folder, as a service is: what one leaves behind the next one finds."""
    found, task = Restarted(), progress.add_task("restarting", total=times)
    with tempfile.TemporaryDirectory(prefix="etd-soak-") as temporary:
        folder = Path(temporary)
        for number in range(times):
            begun_ns = clock.now_ns()
            with _daemon(folder) as daemon:
                started_ns = clock.now_ns()
            ended_ns = clock.now_ns()
            found.started_ms.append((started_ns - begun_ns) / 1e6)
            found.ended_ms.append((ended_ns - started_ns) / 1e6)
            if daemon.returncode:
                found.wrong.append(f"start {number}: ended with {daemon.returncode}")
            progress.advance(task)
    return found


# --- what must hold ------------------------------------------------------------------------------


def bounds_of(soaked: Soaked, restarted: Restarted) -> list[Bound]:
    """The growth is between the medians of two quarters: single looks have noise."""
    held = [at_most("restarts that went wrong", len(restarted.wrong), 0)]
    if not soaked.looks:
        return held
    first, last = soaked.after_warm_up()
    grown_mb = statistics.median(it.mb for it in last) - statistics.median(it.mb for it in first)
    more = statistics.median(it.descriptors for it in last) - statistics.median(
        it.descriptors for it in first
    )
    return [
        *held,
        at_most("frames refused or lost", len(soaked.refused), 0),
        at_most("not ARMED at the end", soaked.state != "ARMED", 0),
        at_most("halts, a missed beat among them", soaked.halt is not None, 0),
        at_most("memory grown, MB", grown_mb, _MOST_GROWTH_MB),
        at_most("descriptors grown", more, _MOST_MORE_DESCRIPTORS),
        at_most("reports dropped", soaked.counters.get("reports_dropped", 0), 0),
    ]


def percentile(values: list[float], part: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))]


def summary(soaked: Soaked, restarted: Restarted) -> dict[str, object]:
    """The figures, without the single looks."""
    found: dict[str, object] = {"seconds": soaked.seconds, "restarts": len(restarted.started_ms)}
    for what, values in (
        ("frame_ms", [it.frame_ms for it in soaked.looks]),
        ("status_ms", [it.status_ms for it in soaked.looks]),
        ("started_ms", restarted.started_ms),
        ("ended_ms", restarted.ended_ms),
    ):
        if values:
            parts = {"p50": 0.5, "p99": 0.99, "max": 1.0}
            found[what] = {name: round(percentile(values, at), 1) for name, at in parts.items()}
    if soaked.looks:
        first, last = soaked.after_warm_up()
        found["mb"] = [round(statistics.median(it.mb for it in part), 1) for part in (first, last)]
        found["descriptors"] = [
            int(statistics.median(it.descriptors for it in part)) for part in (first, last)
        ]
        found["counters"] = soaked.counters
        found["refused"] = soaked.refused[:5]
        found["halt"] = soaked.halt
    return found


def main() -> int:
    parser = argparse.ArgumentParser(prog="soak", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seconds", type=float, default=3_600.0, help="of playing (3600)")
    parser.add_argument("--restarts", type=int, default=1_000, help="starts and ends (1000)")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    console = Console(stderr=args.json)
    with Progress(console=console, disable=not console.is_terminal) as progress:
        soaked = soak(args.seconds, progress) if args.seconds else Soaked(0.0)
        restarted = restart(args.restarts, progress)
    held = bounds_of(soaked, restarted)
    found = summary(soaked, restarted)
    if args.json:
        print(json.dumps({**found, "bounds": [asdict(bound) for bound in held]}))
    else:
        for what, value in found.items():
            console.print(f"{what:>12}  {value}")
        for bound in held:
            if not bound.is_met:
                console.print(f"NOT MET  {bound.what}: {bound.value:g} (bound {bound.bound:g})")
    return 0 if all(bound.is_met for bound in held) else 1


if __name__ == "__main__":
    sys.exit(main())
