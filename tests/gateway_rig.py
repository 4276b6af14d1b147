"""A gateway with real sockets in a folder of its own, a scripted engine, and raw clients.

Owns: stepping them, by hand or in a thread for clients that block. Must not know: what is tested.
"""

from __future__ import annotations

import json
import os
import resource
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import zmq

from etd.client import clock
from etd.files.calibration_process import CalibrationReader
from etd.files.paths import address_of
from etd.gateway.config import GatewayConfig
from etd.gateway.record_file import Disk
from etd.gateway.server import Gateway
from etd.protocol.link import EngineHello
from etd_hal.ports import Clock
from read_in_place import read_in_place
from scripted_engine import ScriptedEngine

#: Turns of 5 ms until something that should arrive counts as not arriving.
PATIENCE = 20_000
#: 2026-01-01, in ns since 1970: the wall's time when the rig's clock was at 0.
WALL_NS = 1_767_225_600_000_000_000


class HandClock:
    """Time that a test moves."""

    def __init__(self) -> None:
        self.t_ns = 1_000_000_000_000

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.t_ns = max(self.t_ns, deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self.sleep_until_ns(deadline_ns)


class RunningClock:
    """CLOCK_MONOTONIC, for a gateway that serves clients which block."""

    def now_ns(self) -> int:
        return clock.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        clock.sleep_s((deadline_ns - clock.now_ns()) / 1e9)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self.sleep_until_ns(deadline_ns)


class GatewayRig:
    """Stepped by the test: `until` gives gateway and engine turns while something is awaited."""

    def __init__(
        self,
        facts: EngineHello | None = None,
        clock: Clock | None = None,
        disk: Disk | None = None,
        reader: CalibrationReader | None = None,
        **config: Any,
    ) -> None:
        self._temporary = tempfile.TemporaryDirectory(prefix="etd-")
        root = Path(self._temporary.name)
        self.folder = root / "run"
        self.folder.mkdir(mode=0o750)
        self.state_dir = root / "state"
        self.clock = HandClock()
        self.config = GatewayConfig(
            **{
                "name": "rig",
                "runtime_folder": self.folder,
                "state_dir": self.state_dir,
                **config,
            }
        )
        self.facts = facts
        self.engine = ScriptedEngine(self.folder, facts)
        self.running = clock or self.clock
        self.gateway = Gateway(
            self.config,
            self.running,
            self._read_clocks,
            disk=disk,
            reader=reader or read_in_place(self.config),
        )
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        #: Until the rig closes, whatever becomes of them in a test.
        self._opened: list[zmq.Socket[bytes]] = []
        self.control = self.socket(zmq.DEALER, "control.sock")

    def __enter__(self) -> Self:
        self.until(lambda: self.call(op="status")["status"]["engine"] == "there")
        self.engine.heard.clear()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.context.destroy(linger=0)
        self.gateway.close()
        self.engine.close()
        self._temporary.cleanup()

    def _read_clocks(self) -> tuple[int, int, int]:
        """The wall's beside the gateway's own, whatever this machine's have been through."""
        now_ns = self.running.now_ns()
        return now_ns, WALL_NS + now_ns, 0

    @property
    def address(self) -> str:
        return address_of(self.folder)

    def socket(self, kind: int, name: str) -> zmq.Socket[bytes]:
        socket = self.context.socket(kind)
        socket.connect(f"ipc://{self.folder / name}")
        self._opened.append(socket)
        return socket

    def step(self, turns: int = 1) -> None:
        for _ in range(turns):
            self.gateway.step(5)
            self.engine.step()

    def until(self, is_there: Callable[[], bool]) -> None:
        """Step until `is_there`; fails if it does not come to be."""
        _until(is_there, self.step)

    def until_gateway(self, is_there: Callable[[], bool]) -> None:
        """The same with an engine that hangs."""
        _until(is_there, lambda: self.gateway.step(5))

    def ask(self, data: bytes | str) -> dict[str, Any]:
        """Any bytes to the control socket; the reply as it came."""
        self.control.send(data.encode() if isinstance(data, str) else data)
        return self.reply()

    def reply(self, socket: zmq.Socket[bytes] | None = None) -> dict[str, Any]:
        waiting = socket or self.control
        self.until(lambda: bool(waiting.poll(0)))
        reply = json.loads(waiting.recv_multipart()[-1])
        assert isinstance(reply, dict)
        return reply

    def call(self, **request: Any) -> dict[str, Any]:
        return self.ask(json.dumps(request))

    def open(self) -> str:
        """A lease, with limits."""
        reply = self.call(
            op="open", client="test", limits={"max_current_ua": 3000, "width_us": 100}
        )
        assert reply["ok"], reply
        return str(reply["lease"])

    def counter(self, name: str) -> int:
        return int(self.call(op="status")["status"]["counters"].get(name, 0))


def _until(is_there: Callable[[], bool], step: Callable[[], None]) -> None:
    for _ in range(PATIENCE):
        if is_there():
            return
        step()
    raise AssertionError("what was waited for did not happen")


class ServedRig(GatewayRig):
    """The same in a thread of its own, for clients that block."""

    def __init__(self, facts: EngineHello | None = None, **config: Any) -> None:
        super().__init__(facts, RunningClock(), **config)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Self:
        super().__enter__()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.pause()
        super().__exit__(kind, error, trace)

    def pause(self) -> None:
        """Nobody is served until `resume`."""
        self._ending.set()
        self._thread.join(120)

    def resume(self) -> None:
        self._ending.clear()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ending.is_set():
            self.step()


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    """For this process, and so for the gateway in it."""
    before, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    lowest = os.dup(0)
    os.close(lowest)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (before, most))
