"""What strangers do to a gateway, each for ever: for `make bench-attack`.

Owns: the strangers (connections that send nothing, messages without end, subscriptions without end,
clients that never read, arrays that decode to much, slow requests, stops and other requests poured,
also from many processes of one user; two other users who take the places, and one who fills the
kernel's line of newcomers). Must not know: what is measured meanwhile, how the gateway defends
itself.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import socket
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from pathlib import Path

import zmq

from etd.client import clock
from etd.files import resources
from etd.files.paths import CONTROL, FRAMES, TELEMETRY
from raw_client import connected, connected_by_others, hello, part, poured

CONNECTS, PROCESSES = 2_000, 70
#: Users of their own, where this is root: of the one who holds places, of the one who churns, and
#: of the one who fills the line.
USERS = (60_001, 60_002, 60_003)
#: More than a user gets beside others; and so many at once that come and go.
HELD, CHURNED = 80, 20
_LARGE = b"x" * 60_000
#: Of each form that a frame has, as large as a message may be; one of them with as many electrodes
#: as there may be. With a number, and without one.
_ARRAYS = tuple(
    b'{"op":"frame",%s"lease":"x",%s]}' % (number, form)
    for number in (b'"seq":1,', b"")
    for form in (
        b'"returns":[' + b",".join([b"[0]"] * 16_300),
        b'"returns":[' + b",".join([b"[%s]" % b",".join([b"257"] * 63)] * 256),
        b'"level":[' + b",".join([b"0.5"] * 16_300),
    )
)
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
    with client_of(folder, zmq.DEALER) as client, ExitStack() as stack:
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
    with client_of(folder, zmq.DEALER) as client:
        while True:
            for _ in range(64):
                client.send(asked)
            while client.poll(20):
                client.recv()
            yield


def ask_for_full_folders(folder: Path) -> Turns:
    """Twenty clients that want to know of a thousand records and of as many calibrations, and to
    open with one of them.
    """
    for kept, suffix in (("records", "jsonl"), ("calibrations", "toml")):
        (folder / "state" / kept).mkdir(mode=0o750, parents=True, exist_ok=True)
        for number in range(_KEPT):
            (folder / "state" / kept / f"kept-{number}.{suffix}").touch(mode=0o640)
    asked = (
        b'{"op": "record", "do": "list"}',
        b'{"op": "hello"}',
        b'{"op": "open", "client": "x", "calibration": "lost"}',
    )
    with ExitStack() as stack:
        clients = [stack.enter_context(client_of(folder, zmq.DEALER)) for _ in range(20)]
        while True:
            for client, request in itertools.product(clients, asked):
                client.send(request)
                while client.poll(0):
                    client.recv()
            yield
            clock.sleep_s(0.001)


def flood(folder: Path) -> Turns:
    """Requests as they can be sent."""
    with client_of(folder, zmq.DEALER) as client:
        while True:
            client.send(b'{"op": "status"}')
            while client.poll(0):
                client.recv()
            yield


def pour_stops(folder: Path) -> Turns:
    """Fifty in a write, each 2 ms."""
    asked = part(b'{"op": "stop"}') * 50
    with connected(folder / CONTROL) as client:
        left = hello("DEALER")
        while True:
            left = left or asked
            left = left[max(0, poured(client, left)) :]
            with contextlib.suppress(BlockingIOError):
                client.recv(1_000_000)
            yield
            clock.sleep_s(0.002)


def ask_for_cold_files(folder: Path) -> Turns:
    """Large calibrations, each of them written again before it is asked for."""
    kept = folder / "state" / "calibrations"
    kept.mkdir(mode=0o750, parents=True, exist_ok=True)
    shipped = resources.find("calibrations", "fake-fingertip-grid-16x16").read_bytes()
    with client_of(folder, zmq.DEALER) as client:
        for number in itertools.count():
            file = kept / f"cold-{number % 60}.toml"
            file.write_bytes(shipped)
            os.chmod(file, 0o640)
            client.send(b'{"op": "calibration", "do": "get", "name": "%s"}' % file.stem.encode())
            while client.poll(20):
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


def hold_places(folder: Path) -> Turns:
    """Another user with more connections than there is room for, and again each that is closed."""
    _become(USERS[0])
    held: list[socket.socket] = []
    with ExitStack() as stack:
        while True:
            held = [one for one in held if _is_open(one)]
            held += map(stack.enter_context, _greeted(folder, HELD - len(held)))
            yield
            clock.sleep_s(0.005)


def churn_places(folder: Path) -> Turns:
    """A third user, whose connections come, are greeted and go, as fast as they can."""
    _become(USERS[1])
    while True:
        made = _greeted(folder, CHURNED)
        yield
        for one in made:
            one.close()
        clock.sleep_s(0.001)


def fill_the_line(folder: Path) -> Turns:
    """Another user, who connects and closes without a pause or a byte: while the kernel's line of
    newcomers is full, nobody else gets into it.
    """
    _become(USERS[2])
    while True:
        for _ in range(CONNECTS):
            with contextlib.suppress(BlockingIOError):
                connected(folder / CONTROL).close()
        yield


def _become(user: int) -> None:
    """The group stays: by it the sockets can be written to."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setuid(user)


def _greeted(folder: Path, count: int) -> list[socket.socket]:
    """New connections, each as a client's after its first write; fewer where the line is full."""
    made: list[socket.socket] = []
    with contextlib.suppress(BlockingIOError):
        for _ in range(count):
            made.append(connected(folder / CONTROL))
            poured(made[-1], hello("DEALER"))
    return made


def _is_open(made: socket.socket) -> bool:
    """What was sent to it is thrown away."""
    try:
        return bool(made.recv(65_536))
    except BlockingIOError:
        return True
    except ConnectionResetError:
        return False


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
        pour_stops,
        ask_for_cold_files,
        many_processes,
        stream_large_frames,
        hold_places,
        churn_places,
        fill_the_line,
    )
}


@contextlib.contextmanager
def client_of(folder: Path, kind: int, name: str = CONTROL) -> Iterator[zmq.Socket[bytes]]:
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
