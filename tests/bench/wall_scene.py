"""The engine on wall-clock ports beside a load, for minutes: it must not halt, nor wait for a lock.

    python tests/bench/wall_scene.py [--seconds 120] [--threads]

Owns: the scene (two processors: the scan's, and one with a hog, gateway and client), its witnesses,
and the verdict. Must not know: how the figures are taken (`wall_scan.py`), the ports
(`wall_ports.py`).

A halt is excused only where the machine took the scan's processor meanwhile. Two in C tell that:
the calls themselves, which hold no interpreter's lock, note when they were kept from it; and a
witness on each core, at a priority above all else, notes when it woke late.

With `--threads` the verdict is on what the waits for the interpreter's lock are, and not on halts:
whether a wait falls into a message, and so halts, is chance, and a host that often takes the
processor excuses each.

On a host that takes the processor so often that chance alone excuses a halt, or makes one, nothing
is shown: neither that the scan is at fault, nor that it is not.

Exit status: 0 as it must be, 1 it is not, 3 the machine does not grant what the scene needs.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

from bench import wall_ports, wall_scan  # noqa: E402
from bench.modelled import CURRENT_UA, ELECTRODES, WIDTH_US  # noqa: E402
from bench.process_facts import ProcessFacts, facts_of  # noqa: E402
from etd.client import Display, clock  # noqa: E402
from etd.files.paths import CONTROL, address_of  # noqa: E402
from etd.protocol.errors import Refused  # noqa: E402
from etd.protocol.messages import StateReport  # noqa: E402

_WITNESS_PRIORITY = 99
_READY_WITHIN_NS = 30_000_000_000
_RATE_HZ = 20.0
_TTL_MS = 1_000
#: At p99.9: alone in its process the scan waits 1 to 27 us, as the witness interrupts it, beside
#: threads 63 to 82; on a host that is busy as well. A faster machine has 1, and 29 to 40: beside
#: threads as much is seen as a busy host has without them.
_LOCK_WAIT_US, _SEEN_US = 45.0, 20.0
#: A halt is stamped when the board has been made safe: its whole chain was written.
_NOTED_NS = 5_000_000
#: Of the time: where more of it excuses a halt than this, the verdict would be chance.
_MOST_EXCUSED = 0.1


@dataclass
class Found:
    """What the scene showed."""

    seconds: float
    #: (when, why), on CLOCK_MONOTONIC.
    halts: list[tuple[int, str]] = field(default_factory=list)
    #: (from, to) of each time that the machine took the scan's processor.
    stalls_ns: list[tuple[int, int]] = field(default_factory=list)
    #: How late each of the witnesses' looks came that came late, and how many looks there were.
    late_ns: list[int] = field(default_factory=list)
    looks: int = 0
    not_granted: tuple[str, ...] = ()
    figures: dict[str, dict[str, float]] = field(default_factory=dict)
    busy_percent: float = 0.0
    #: The engine and the gateway, as they were at the start.
    processes: tuple[ProcessFacts, ...] = ()
    #: So long frames were shown; the remainder went into arming.
    shown_s: float = 0.0

    def unexcused(self) -> list[str]:
        """A halt is noticed at the end of what was too long; a stall ends before that."""
        return [why for at_ns, why in self.halts if not self._is_the_hosts(at_ns)]

    def _is_the_hosts(self, halt_ns: int) -> bool:
        return any(begun <= halt_ns <= end + _NOTED_NS for begun, end in self.stalls_ns)

    def excused_share(self) -> float:
        """Of the scene's time, that in which a halt would be taken for the host's."""
        excused_ns = 0
        reached_ns = 0
        for begun, end in sorted(self.stalls_ns):
            until_ns = end + _NOTED_NS
            excused_ns += max(0, until_ns - max(begun, reached_ns))
            reached_ns = max(reached_ns, until_ns)
        return excused_ns / (self.seconds * 1e9)

    def waits_for_the_lock(self, most_us: float = _LOCK_WAIT_US) -> bool:
        return self.figures[wall_scan.LOCK_WAITS]["p99.9"] > most_us

    def sentences(self) -> list[str]:
        told = [f"{self.seconds:.0f} s, {self.shown_s:.0f} of them shown"]
        told.append(f"the scan busy for {self.busy_percent:.0f} %")
        stalled_ns = [end - begun for begun, end in self.stalls_ns]
        told.append(f"the machine took the scan's processor: {_longest(stalled_ns)}")
        told.append(
            f"a halt would be taken for the host's in {self.excused_share():.0%} of the time"
        )
        late = f"{_longest(self.late_ns)}, of {self.looks} looks"
        told.append(f"late by more than 100 us at priority {_WITNESS_PRIORITY}: {late}")
        for name, spread in self.figures.items():
            values = ", ".join(f"{key} {value:.0f}" for key, value in spread.items())
            told.append(f"{name}: {values}")
        unexcused = self.unexcused()
        told += [f"HALTED: {why}" for why in unexcused]
        told.append(f"{len(self.halts)} halts, {len(self.halts) - len(unexcused)} the host's")
        return told


def play(seconds: float, kind: str = "processes") -> Found:
    """The whole scene; what works beside the scan is of that kind. Raises: OSError where the
    machine does not grant it.
    """
    scan_core, other_core = _cores()
    with tempfile.TemporaryDirectory(prefix="etd-wall-") as temporary, ExitStack() as stack:
        folder = Path(temporary)
        library, program = wall_ports.build(folder)
        outs = [folder / f"stalls.{core}" for core in (scan_core, other_core)]
        _started(stack, program, "hog", str(other_core))
        engine = _engine(stack, folder, library, scan_core, kind)
        gateway = _gateway(stack, folder, other_core)
        processes = facts_of("the engine", engine.pid), facts_of("the gateway", gateway.pid)
        witnesses = [
            _started(stack, program, "witness", str(core), str(_WITNESS_PRIORITY), str(out))
            for core, out in zip((scan_core, other_core), outs, strict=True)
        ]
        found = _drive(folder, seconds)
        found.processes = processes
        for process in (engine, *witnesses):
            process.terminate()
            assert process.wait(_READY_WITHIN_NS / 1e9) == 0
        figures = json.loads((folder / wall_scan.FIGURES).read_text("utf-8"))
        found.figures = figures["spreads"]
        found.stalls_ns = [(begun, end) for begun, end in figures["stalls_ns"]]
        for out in outs:
            *late, (looks, _) = _lines(out)
            found.late_ns += [end - begun for begun, end in late]
            if out is outs[0]:
                found.stalls_ns += late
            found.looks += looks
    return found


def _cores() -> tuple[int, int]:
    """The scan's, and that of all else: the last two."""
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        raise OSError("two processors are needed, and there is one")
    return cores[-1], cores[-2]


def _started(stack: ExitStack, *command: str | Path, core: int | None = None) -> Any:
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    stack.enter_context(_ended(process))
    if core is not None:
        os.sched_setaffinity(process.pid, {core})
    return process


@contextmanager
def _ended(process: subprocess.Popen[bytes]) -> Iterator[None]:
    with process:
        try:
            yield
        finally:
            process.terminate()


def _engine(stack: ExitStack, folder: Path, library: Path, core: int, kind: str) -> Any:
    script = Path(__file__).with_name("wall_scan.py")
    engine = _started(stack, sys.executable, script, folder, library, str(core), kind)
    if engine.stdout.readline() != b"ready\n":
        raise OSError("the engine did not come up")
    return engine


def _gateway(stack: ExitStack, folder: Path, core: int) -> Any:
    part = ("run", "--part", "gateway", "--name", "wall", "--board", "fake")
    command = (sys.executable, "-m", "etd", *part, "--folder", str(folder))
    gateway = _started(stack, *command, core=core)
    deadline_ns = clock.now_ns() + _READY_WITHIN_NS
    while clock.now_ns() < deadline_ns:
        if (folder / CONTROL).exists():
            with Display(address=address_of(folder)) as display:
                if display.status().engine == "there":
                    return gateway
        clock.sleep_s(0.05)
    raise TimeoutError("the gateway has found no engine")


def _drive(folder: Path, seconds: float) -> Found:
    """All electrodes, for so long; after a halt, or a lease that lapsed, once more."""
    found = Found(seconds)
    until_ns = clock.now_ns() + int(seconds * 1e9)
    while clock.now_ns() < until_ns:
        with Display(address=address_of(folder), max_current_ua=1_000, width_us=200) as display:
            try:
                _show_until(display, folder, found, until_ns)
            except Refused as refused:
                _note(found, display.status())
                print(f"refused: {refused}", file=sys.stderr)
    return found


def _show_until(display: Display, folder: Path, found: Found, until_ns: int) -> None:
    """Raises: Refused."""
    if display.status().halt is not None:
        display.clear()
    _try_stop(folder)
    display.arm()
    while clock.now_ns() < until_ns:
        begun_ns = clock.now_ns()
        display.show_current(
            (CURRENT_UA,) * ELECTRODES, width_us=WIDTH_US, rate_hz=_RATE_HZ, ttl_ms=_TTL_MS
        )
        clock.sleep_s(_TTL_MS / 4_000)
        found.shown_s += (clock.now_ns() - begun_ns) / 1e9
        _note(found, display.status())


def _try_stop(folder: Path) -> None:
    trying = folder / wall_scan.TRY_STOP
    trying.touch()
    while trying.exists():
        clock.sleep_s(0.01)


def _note(found: Found, report: StateReport) -> None:
    found.not_granted = report.not_granted
    found.busy_percent = max(found.busy_percent, report.busy_percent)
    if report.halt is not None:
        halt = (report.halt.t_ns, f"{report.halt.source}: {report.halt.detail}")
        if halt not in found.halts:
            found.halts.append(halt)


def _lines(out: Path) -> list[tuple[int, int]]:
    lines = out.read_text("ascii").splitlines()
    return [(int(begun), int(end)) for begun, end in (line.split() for line in lines)]


def _longest(durations_ns: list[int]) -> str:
    return f"{len(durations_ns)}, the longest {max(durations_ns, default=0) / 1_000:.0f} us"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="wall_scene", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument(
        "--threads",
        action="store_true",
        help="sensors and stopper as threads: it must wait for the interpreter's lock",
    )
    args = parser.parse_args(arguments)
    # Ended from outside, it leaves no hog behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        found = play(args.seconds, "threads" if args.threads else "processes")
    except OSError as error:
        print(f"the scene cannot be played here: {error}", file=sys.stderr)
        return 3
    for sentence in (*found.not_granted, *found.sentences()):
        print(sentence)
    return verdict(found, args.threads)


def verdict(found: Found, with_threads: bool) -> int:
    """The exit status; why nothing is shown is printed."""
    if any("not granted" in sentence for sentence in found.not_granted):
        return 3
    if found.excused_share() > _MOST_EXCUSED:
        print(
            f"nothing is shown: a host this busy excuses more than {_MOST_EXCUSED:.0%} of the time"
        )
        return 3
    if with_threads:
        return 0 if found.waits_for_the_lock(_SEEN_US) else 1
    return 1 if found.unexcused() or found.waits_for_the_lock() else 0


if __name__ == "__main__":
    sys.exit(main())
