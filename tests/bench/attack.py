"""`make bench-attack`: a stop while strangers do to the gateway what they can.

Owns: the strangers' processes, each at nice 19; how long a stop takes to the engine and back
meanwhile, and `etd stop` from its start to its end; and the gateway's memory and descriptors. Exit
status 1 where a bound is not met. Must not know: what a stranger does (`strangers.py`), how the
gateway defends itself.

The engine is real, on ports that cost nothing (`wall_engine.py`); all of it is on this machine.
Three strangers are users of their own where this is run as root.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import zmq  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.progress import track  # noqa: E402
from rich.table import Table  # noqa: E402

from bench.latency import ended, wait_for_engine  # noqa: E402
from bench.run import Bound, at_most  # noqa: E402
from bench.strangers import (  # noqa: E402
    STRANGERS,
    Stranger,
    churn_places,
    client_of,
    fill_the_line,
    hold_places,
    pour_stops,
)
from etd.client import clock  # noqa: E402
from etd.files.paths import TELEMETRY  # noqa: E402

_HERE = Path(__file__).resolve().parent
STOPS = 200
#: Of so many stops one is made by the command as well, which starts a Python for each.
_COMMAND_EVERY = 10
#: Of a stop: until the engine has heard it, and until its reply is there; and of the gateway.
HEARD_P99_MS, ANSWERED_P99_MS = 20.0, 50.0
MOST_MB, MOST_DESCRIPTORS = 100.0, 300
#: Of a new client, where the kernel's line of newcomers is filled: libzmq tries again after 100 ms.
CONNECTED_P99_MS = 100.0
_WITHIN_MS = 10_000
#: Other stops than those that are measured.
_POURED = pour_stops.__name__
#: Neither does harm alone: one fills what there is, the other makes others give way.
_TAKE_PLACES = (hold_places.__name__, churn_places.__name__)
#: So long they have been at it when the first stop is measured.
_LOADED_S = 2.0


def _attack(stranger: Stranger, folder: Path) -> int:
    """Without an end; after its first turn it is said that it has begun."""
    for turn, _ in enumerate(stranger(folder)):
        if not turn:
            print("ready", flush=True)
    raise AssertionError("a stranger does not end by itself")


# --- stops ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Figures:
    """Of stops, in ms, and before each a new client's connection and first reply; `lost`: within
    ten seconds no reply came. Of `etd stop`, from its start to its end; `command_failed`: it said
    that something is not stopped. Of the gateway, the most.
    """

    load: str
    stops: int
    lost: int
    connected_p50_ms: float
    connected_p99_ms: float
    heard_p50_ms: float
    heard_p99_ms: float
    answered_p50_ms: float
    answered_p99_ms: float
    commands: int
    command_failed: int
    command_p50_ms: float
    command_most_ms: float
    most_mb: float
    most_descriptors: int


@dataclass
class _Gateway:
    folder: Path
    pid: int
    most_mb: float = 0.0
    most_descriptors: int = 0

    def look(self) -> None:
        pages = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1])
        self.most_mb = max(self.most_mb, pages * os.sysconf("SC_PAGE_SIZE") / 1e6)
        count = len(os.listdir(f"/proc/{self.pid}/fd"))
        self.most_descriptors = max(self.most_descriptors, count)


def measure(load: str, strangers: tuple[str, ...], stops: int) -> Figures:
    """A gateway and an engine of its own, these strangers, and so many stops."""
    with tempfile.TemporaryDirectory(prefix="etd-bench-") as temporary, ExitStack() as stack:
        folder = Path(temporary)
        # Who may use the display passes through; for a stranger's user as well.
        folder.chmod(0o710)
        engine = [sys.executable, str(_HERE / "wall_engine.py"), str(folder)]
        stack.enter_context(ended(subprocess.Popen(engine, stdout=subprocess.PIPE)))
        part = ("run", "--part", "gateway", "--name", "bench", "--board", "fake")
        line = [sys.executable, "-m", "etd", *part, "--folder", str(folder)]
        gateway = subprocess.Popen(line, stderr=subprocess.DEVNULL)
        stack.enter_context(ended(gateway))
        wait_for_engine(folder)
        nice = ["nice", "-n", "19", sys.executable, __file__, "--folder", str(folder)]
        attacking = {
            name: subprocess.Popen([*nice, "--stranger", name], stdout=subprocess.PIPE)
            for name in strangers
        }
        for stranger in attacking.values():
            stack.enter_context(ended(stranger))
        clock.sleep_s(_LOADED_S if strangers else 0.2)
        watched = _Gateway(folder, gateway.pid)
        with client_of(folder, zmq.SUB, TELEMETRY) as reports:
            # The last subscription's first report: the other one is heard by then.
            for topic in (b"halt", b"state"):
                reports.setsockopt(zmq.SUBSCRIBE, topic)
            reports.poll(_WITHIN_MS)
            is_poured = _POURED in strangers
            found = [
                _stop(watched, reports, is_poured=is_poured)
                for _ in track(range(stops), load, transient=True)
            ]
            commands = [
                _stopped_by_command(folder)
                for _ in track(range(-(-stops // _COMMAND_EVERY)), f"{load}, etd stop")
            ]
        assert gateway.poll() is None, "the gateway has ended"
        for name, stranger in attacking.items():
            assert stranger.poll() is None, f"{name} has ended: nothing is shown"
        return _figures(load, found, commands, watched)


def _stop(
    gateway: _Gateway, reports: zmq.Socket[bytes], *, is_poured: bool
) -> tuple[float, float, float] | None:
    """In ms: until a new client has a first reply; of its stop, until the engine heard it, and
    until its reply. None if one did not come. Where other stops have halted it before, it was heard
    by its reply at the latest, and that is what counts.
    """
    made_ns = clock.now_ns()
    with client_of(gateway.folder, zmq.DEALER) as client:
        cleared = _asked(client, b'{"op": "clear"}')
        if cleared is None:
            return None
        connected_ms = (clock.now_ns() - made_ns) / 1e6
        if json.loads(cleared).get("error") != "busy":
            times_ms = _heard_and_answered(gateway, client, reports, is_hidden=is_poured)
            return times_ms and (connected_ms, *times_ms)
    # Where strangers of the same user have all connections, a newcomer is heard only to stop, and
    # leaves after anything else: the stop comes from another one. The board stays halted then, and
    # no report tells when it heard this stop.
    with client_of(gateway.folder, zmq.DEALER) as client:
        times_ms = _heard_and_answered(gateway, client, reports, is_hidden=True)
        return times_ms and (connected_ms, *times_ms)


def _heard_and_answered(
    gateway: _Gateway,
    client: zmq.Socket[bytes],
    reports: zmq.Socket[bytes],
    *,
    is_hidden: bool,
) -> tuple[float, float] | None:
    gateway.look()
    begun_ns = clock.now_ns()
    if _asked(client, b'{"op": "stop", "client": "bench"}') is None:
        return None
    answered_ms = (clock.now_ns() - begun_ns) / 1e6
    if is_hidden:
        return answered_ms, answered_ms
    while reports.poll(_WITHIN_MS):
        topic, report = reports.recv_multipart()
        heard_ns = json.loads(report)["t_ns"] if topic == b"halt" else 0
        if heard_ns >= begun_ns:
            return (heard_ns - begun_ns) / 1e6, answered_ms
    return None


def _stopped_by_command(folder: Path) -> float | None:
    """In ms, with the start of its Python; None where it says that something is not stopped."""
    begun_ns = clock.now_ns()
    line = [sys.executable, "-m", "etd", "stop", "--folder", str(folder)]
    ran = subprocess.run(line, check=False, capture_output=True, timeout=_WITHIN_MS / 1e3)
    return (clock.now_ns() - begun_ns) / 1e6 if ran.returncode == 0 else None


def _asked(client: zmq.Socket[bytes], request: bytes) -> bytes | None:
    client.send(request)
    return client.recv() if client.poll(_WITHIN_MS) else None


def _figures(
    load: str,
    found: list[tuple[float, float, float] | None],
    commands: list[float | None],
    gateway: _Gateway,
) -> Figures:
    whole = [one for one in found if one is not None]
    by_command = sorted(one for one in commands if one is not None)
    assert by_command, f"{load}: no `etd stop` was answered"
    assert whole, f"{load}: no stop was answered"
    connected, heard, answered = (sorted(column) for column in zip(*whole, strict=True))
    return Figures(
        load,
        stops=len(found),
        lost=len(found) - len(whole),
        connected_p50_ms=_percentile(connected, 0.5),
        connected_p99_ms=_percentile(connected, 0.99),
        heard_p50_ms=_percentile(heard, 0.5),
        heard_p99_ms=_percentile(heard, 0.99),
        answered_p50_ms=_percentile(answered, 0.5),
        answered_p99_ms=_percentile(answered, 0.99),
        commands=len(commands),
        command_failed=len(commands) - len(by_command),
        command_p50_ms=_percentile(by_command, 0.5),
        command_most_ms=by_command[-1],
        most_mb=gateway.most_mb,
        most_descriptors=gateway.most_descriptors,
    )


def _percentile(ordered: list[float], part: float) -> float:
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))]


def bounds(found: Figures) -> list[Bound]:
    of_the_line = []
    if found.load == fill_the_line.__name__:
        what = f"{found.load}: a new client's first reply, p99, ms"
        of_the_line = [at_most(what, found.connected_p99_ms, CONNECTED_P99_MS)]
    return [
        *of_the_line,
        at_most(f"{found.load}: stops without a reply", found.lost, 0),
        at_most(f"{found.load}: heard by the engine, p99, ms", found.heard_p99_ms, HEARD_P99_MS),
        at_most(f"{found.load}: answered, p99, ms", found.answered_p99_ms, ANSWERED_P99_MS),
        at_most(f"{found.load}: etd stop, not stopped", found.command_failed, 0),
        at_most(f"{found.load}: the gateway's memory, MB", found.most_mb, MOST_MB),
        at_most(f"{found.load}: its descriptors", found.most_descriptors, MOST_DESCRIPTORS),
    ]


def show(console: Console, found: list[Figures]) -> None:
    table = Table(title="a stop, and the gateway, while strangers do what they can")
    for title in (
        "",
        "stops",
        "connected ms (p50, p99)",
        "heard ms",
        "answered ms",
        "etd stop, whole (p50, most)",
        "MB",
        "descriptors",
    ):
        table.add_column(title, justify="left" if not title else "right")
    for one in found:
        table.add_row(
            one.load,
            f"{one.stops}" + (f", {one.lost} LOST" if one.lost else ""),
            f"{one.connected_p50_ms:.1f}, {one.connected_p99_ms:.1f}",
            f"{one.heard_p50_ms:.1f}, {one.heard_p99_ms:.1f}",
            f"{one.answered_p50_ms:.1f}, {one.answered_p99_ms:.1f}",
            f"{one.command_p50_ms:.0f}, {one.command_most_ms:.0f}"
            + (f", {one.command_failed} FAILED" if one.command_failed else ""),
            f"{one.most_mb:.0f}",
            f"{one.most_descriptors}",
        )
    console.print(table)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="bench-attack", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--stops", type=int, default=STOPS)
    parser.add_argument("--only", nargs="+", choices=STRANGERS, help="these strangers, all at once")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--stranger", choices=STRANGERS, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.stranger is not None:
        return _attack(STRANGERS[args.stranger], args.folder)
    # Who pours stops hides when another one was heard: it attacks alone.
    at_once = args.only or [name for name in STRANGERS if name != _POURED]
    loads: dict[str, tuple[str, ...]] = {"no stranger": ()}
    if args.only is None:
        loads |= {name: (name,) for name in STRANGERS}
        loads["places taken by two users"] = _TAKE_PLACES
    loads["all of them at once"] = tuple(at_once)
    found = [measure(load, strangers, args.stops) for load, strangers in loads.items()]
    held = [bound for one in found for bound in bounds(one)]
    console = Console(width=None if sys.stdout.isatty() else 120)
    if args.json:
        print(json.dumps([asdict(one) for one in found]))
    else:
        show(console, found)
        for bound in held:
            if not bound.is_met:
                console.print(f"NOT MET  {bound.what}: {bound.value:g} (bound {bound.bound:g})")
    return 0 if all(bound.is_met for bound in held) else 1


if __name__ == "__main__":
    sys.exit(main())
