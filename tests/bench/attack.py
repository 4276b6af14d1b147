"""`make bench-attack`: a stop while strangers do to the gateway what they can.

Owns: the strangers (connections that send nothing, messages without end, subscriptions without end,
clients that never read, arrays that decode to much, slow requests, floods, also from many processes
of one user), each a process of its own at nice 19; how long a stop takes to the engine and back
meanwhile; and the gateway's memory and descriptors. Exit status 1 where a bound is not met. Must
not know: how the gateway defends itself.

The engine is real, on ports that cost nothing (`wall_engine.py`); all of it is on this machine.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator, Iterator
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
from etd.client import clock  # noqa: E402
from etd.files.paths import CONTROL, FRAMES, TELEMETRY  # noqa: E402
from raw_client import connected, connected_by_others, hello, part, poured  # noqa: E402

_HERE = Path(__file__).resolve().parent
STOPS, CONNECTS, PROCESSES = 200, 2_000, 70
#: Of a stop: until the engine has heard it, and until its reply is there; and of the gateway.
HEARD_P99_MS, ANSWERED_P99_MS = 20.0, 50.0
MOST_MB, MOST_DESCRIPTORS = 100.0, 300
_WITHIN_MS = 10_000
_LARGE = b"x" * 60_000
#: Of each form that a frame has, as large as a message may be; one of them with as many electrodes
#: as there may be.
_ARRAYS = tuple(
    b'{"op":"frame","lease":"x","seq":1,%s]}' % form
    for form in (
        b'"returns":[' + b",".join([b"[0]"] * 16_300),
        b'"returns":[' + b",".join([b"[%s]" % b",".join([b"257"] * 63)] * 256),
        b'"level":[' + b",".join([b"0.5"] * 16_300),
    )
)
#: So long they have been at it when the first stop is measured.
_LOADED_S = 2.0
#: In each of its folders, as many as may be there.
_KEPT = 1_000

#: An attack, turn by turn.
Turns = Generator[None, None, None]
Stranger = Callable[[Path], Turns]


# --- what strangers do ---------------------------------------------------------------------------


def connect_only(folder: Path) -> Turns:
    """Two thousand connections to both sockets that never send a byte, again and again."""
    while True:
        with ExitStack() as stack:
            for number in range(CONNECTS):
                with contextlib.suppress(BlockingIOError):
                    stack.enter_context(connected(folder / (CONTROL, TELEMETRY)[number % 2]))
                if number % 50 == 49:
                    yield
                    clock.sleep_s(0.01)


def endless_multipart(folder: Path) -> Turns:
    """One message that never ends, and once it is cut off the next one."""
    while True:
        for _ in _pour(folder / CONTROL, hello("DEALER"), lambda: part(_LARGE, more=True)):
            yield
            clock.sleep_s(0.001)


def subscribe_without_end(folder: Path) -> Turns:
    """A topic that is another one each time."""
    numbers = itertools.count()

    def topics() -> bytes:
        return b"".join(part(b"\x01%040d" % next(numbers)) for _ in range(100))

    while True:
        for _ in _pour(folder / TELEMETRY, hello("SUB"), topics):
            yield
            clock.sleep_s(0.001)


def never_read(folder: Path) -> Turns:
    """Requests whose refusals quote what was sent, from a hundred clients that read no reply."""
    asked = part(json.dumps({"op": _LARGE.decode()}).encode())
    while True:
        with ExitStack() as stack:
            pouring = [_pour(folder / CONTROL, hello("DEALER"), lambda: asked) for _ in range(100)]
            for one in pouring:
                stack.callback(one.close)
            while pouring:
                pouring = [one for one in pouring if next(one, "ended") is None]
                yield
                clock.sleep_s(0.01)


def send_large_arrays(folder: Path) -> Turns:
    """Frames of a few bytes an element, which take fifty once they are decoded: as fast as they are
    answered, by a client without a lease; and on connections that have not read what came before.
    """
    asked = part(b'{"op": "calibration", "do": "get", "name": "fake-fingertip"}') * 40
    frames = itertools.cycle(_ARRAYS)
    with _connected(folder, zmq.DEALER) as client, ExitStack() as stack:
        first = hello("DEALER") + asked
        pouring = [_pour(folder / CONTROL, first, lambda: part(next(frames))) for _ in range(60)]
        for one in pouring:
            stack.callback(one.close)
        while True:
            pouring = [one for one in pouring if next(one, "ended") is None]
            for frame in _ARRAYS:
                client.send(frame)
            while client.poll(20):
                client.recv()
            yield


def ask_for_slow_things(folder: Path) -> Turns:
    """Calibrations, as many at once as fit."""
    asked = b'{"op": "calibration", "do": "get", "name": "fake-fingertip-grid-16x16"}'
    with _connected(folder, zmq.DEALER) as client:
        while True:
            for _ in range(64):
                client.send(asked)
            while client.poll(20):
                client.recv()
            yield


def ask_for_full_folders(folder: Path) -> Turns:
    """Twenty clients that want to know of a thousand records and of as many calibrations."""
    for kept, suffix in (("records", "jsonl"), ("calibrations", "toml")):
        (folder / "state" / kept).mkdir(mode=0o750, parents=True, exist_ok=True)
        for number in range(_KEPT):
            (folder / "state" / kept / f"kept-{number}.{suffix}").touch(mode=0o640)
    asked = (b'{"op": "record", "do": "list"}', b'{"op": "hello"}')
    with ExitStack() as stack:
        clients = [stack.enter_context(_connected(folder, zmq.DEALER)) for _ in range(20)]
        while True:
            for client, request in itertools.product(clients, asked):
                client.send(request)
                while client.poll(0):
                    client.recv()
            yield
            clock.sleep_s(0.001)


def flood(folder: Path) -> Turns:
    """Requests as they can be sent."""
    with _connected(folder, zmq.DEALER) as client:
        while True:
            client.send(b'{"op": "status"}')
            while client.poll(0):
                client.recv()
            yield


def many_processes(folder: Path) -> Turns:
    """Requests as they can be sent, short ones and long ones, by seventy connections of as many
    processes: children that connect, hand the connection back and end.
    """
    asked = itertools.cycle([part(b'{"op": "status"}') * 50, *map(part, _ARRAYS)])
    with ExitStack() as stack:
        unsent: dict[socket.socket, bytes] = {}
        for made in connected_by_others(folder / CONTROL, PROCESSES):
            unsent[stack.enter_context(made)] = hello("DEALER")
            yield
        while True:
            for client, left in unsent.items():
                left = left or next(asked)
                unsent[client] = left[max(0, poured(client, left)) :]
                with contextlib.suppress(BlockingIOError, ConnectionResetError):
                    client.recv(65_536)
            yield


def stream_large_frames(folder: Path) -> Turns:
    """To the other socket, where nobody is answered."""
    frames = itertools.cycle([part(frame) for frame in _ARRAYS])
    with ExitStack() as stack:
        pouring = [
            _pour(folder / FRAMES, hello("PUSH"), lambda: next(frames)) for _ in range(PROCESSES)
        ]
        for one in pouring:
            stack.callback(one.close)
        while True:
            pouring = [one for one in pouring if next(one, "ended") is None]
            yield
            clock.sleep_s(0.001)


STRANGERS: dict[str, Stranger] = {
    one.__name__: one
    for one in (
        connect_only,
        endless_multipart,
        subscribe_without_end,
        never_read,
        send_large_arrays,
        ask_for_slow_things,
        ask_for_full_folders,
        flood,
        many_processes,
        stream_large_frames,
    )
}


@contextlib.contextmanager
def _connected(folder: Path, kind: int, name: str = CONTROL) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(kind) as made:
        made.setsockopt(zmq.LINGER, 0)
        made.connect(f"ipc://{folder / name}")
        yield made


def _pour(to: Path, first: bytes, data: Callable[[], bytes]) -> Turns:
    """As much as the kernel takes, without reading, until the gateway closes it. By hand: a library
    of ZeroMQ would store without a bound what the gateway does not read, and not be the attacker
    but the attacked.
    """
    with contextlib.suppress(BlockingIOError), connected(to) as made:
        left = first
        while (sent := poured(made, left)) >= 0:
            left = left[sent:] or data()
            if not sent:
                yield
    yield


def _attack(stranger: Stranger, folder: Path) -> int:
    """Without an end; after its first turn it is said that it has begun."""
    for turn, _ in enumerate(stranger(folder)):
        if not turn:
            print("ready", flush=True)
    raise AssertionError("a stranger does not end by itself")


# --- stops ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Figures:
    """Of stops, in ms; `lost`: within ten seconds no reply came. Of the gateway, the most."""

    load: str
    stops: int
    lost: int
    heard_p50_ms: float
    heard_p99_ms: float
    answered_p50_ms: float
    answered_p99_ms: float
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
        with _connected(folder, zmq.SUB, TELEMETRY) as reports:
            # The last subscription's first report: the other one is heard by then.
            for topic in (b"halt", b"state"):
                reports.setsockopt(zmq.SUBSCRIBE, topic)
            reports.poll(_WITHIN_MS)
            found = [_stop(watched, reports) for _ in track(range(stops), load, transient=True)]
        assert gateway.poll() is None, "the gateway has ended"
        for name, stranger in attacking.items():
            assert stranger.poll() is None, f"{name} has ended: nothing is shown"
        return _figures(load, found, watched)


def _stop(gateway: _Gateway, reports: zmq.Socket[bytes]) -> tuple[float, float] | None:
    """In ms until the engine heard it, and until its reply; None if that did not come."""
    with _connected(gateway.folder, zmq.DEALER) as client:
        _asked(client, b'{"op": "clear"}')
        gateway.look()
        begun_ns = clock.now_ns()
        if _asked(client, b'{"op": "stop", "client": "bench"}') is None:
            return None
        answered_ns = clock.now_ns()
        while reports.poll(_WITHIN_MS):
            topic, report = reports.recv_multipart()
            heard_ns = json.loads(report)["t_ns"] if topic == b"halt" else 0
            if heard_ns >= begun_ns:
                return (heard_ns - begun_ns) / 1e6, (answered_ns - begun_ns) / 1e6
        return None


def _asked(client: zmq.Socket[bytes], request: bytes) -> bytes | None:
    client.send(request)
    return client.recv() if client.poll(_WITHIN_MS) else None


def _figures(load: str, found: list[tuple[float, float] | None], gateway: _Gateway) -> Figures:
    whole = [one for one in found if one is not None]
    assert whole, f"{load}: no stop was answered"
    heard, answered = (sorted(column) for column in zip(*whole, strict=True))
    return Figures(
        load,
        stops=len(found),
        lost=len(found) - len(whole),
        heard_p50_ms=_percentile(heard, 0.5),
        heard_p99_ms=_percentile(heard, 0.99),
        answered_p50_ms=_percentile(answered, 0.5),
        answered_p99_ms=_percentile(answered, 0.99),
        most_mb=gateway.most_mb,
        most_descriptors=gateway.most_descriptors,
    )


def _percentile(ordered: list[float], part: float) -> float:
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))]


def bounds(found: Figures) -> list[Bound]:
    return [
        at_most(f"{found.load}: stops without a reply", found.lost, 0),
        at_most(f"{found.load}: heard by the engine, p99, ms", found.heard_p99_ms, HEARD_P99_MS),
        at_most(f"{found.load}: answered, p99, ms", found.answered_p99_ms, ANSWERED_P99_MS),
        at_most(f"{found.load}: the gateway's memory, MB", found.most_mb, MOST_MB),
        at_most(f"{found.load}: its descriptors", found.most_descriptors, MOST_DESCRIPTORS),
    ]


def show(console: Console, found: list[Figures]) -> None:
    table = Table(title="a stop, and the gateway, while strangers do what they can")
    for title in ("", "stops", "heard ms (p50, p99)", "answered ms", "MB", "descriptors"):
        table.add_column(title, justify="left" if not title else "right")
    for one in found:
        table.add_row(
            one.load,
            f"{one.stops}" + (f", {one.lost} LOST" if one.lost else ""),
            f"{one.heard_p50_ms:.1f}, {one.heard_p99_ms:.1f}",
            f"{one.answered_p50_ms:.1f}, {one.answered_p99_ms:.1f}",
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
    loads = {"no stranger": (), "all of them at once": tuple(args.only or STRANGERS)}
    if args.only is None:
        loads = {"no stranger": (), **{name: (name,) for name in STRANGERS}, **loads}
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
