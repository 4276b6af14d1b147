"""A whole daemon in one thread with two clients that speak ZMTP by hand: what they do and what must
hold whatever they do.

Owns: the verbs, and the judgments after each: one reply to each request, one holder of the lease,
a halt that stays, a supply that is off, and what the body got (`body_judge.py`). Must not know:
which stories are told.

Sockets that are written and read here have no threads behind them: the same story goes the same
way.
"""

from __future__ import annotations

import json
import socket
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import engine_rig
from body_judge import Judge
from campaign.account import AccountedBody
from charge_witness import Witness, even_skin
from etd.files.configuration import fake_config
from etd.gateway.config import GatewayConfig
from etd.gateway.server import Gateway
from etd.protocol.link import Channel, Listener
from etd.protocol.messages import Limits
from etd.protocol.zmtp import Reader
from etd.safety.lease import Lease
from etd_hal.backend import Backend
from etd_hal.bench import StopName
from etd_hal.fake.faults import Fault
from etd_hal.ports import Changes, Edge, Gpio
from raw_client import connected, hello, part, poured
from read_in_place import read_in_place

BOARD, ELECTRODES = "reference-hv507", 8
MS = 1_000_000
#: The gateway has a turn this often.
_GATEWAY_NS = 2 * MS
_WALL_NS = 1_790_000_000_000_000_000
#: Beyond the 15 s after which a gateway gives up on its engine.
_LAST_REPLY_NS = 17_000 * MS
_STOPS_WITHIN_NS = 100 * MS
#: Answered with the lease alone.
OF_LEASE = ("keep", "close", "disarm", "measure", "mark")


class _WatchedGpio:
    """The board's lines, and what the one that switches the supply was set to last."""

    def __init__(self, gpio: Gpio, line: int) -> None:
        self._gpio, self._line = gpio, line
        self.level: int | None = None

    def set(self, changes: Changes) -> None:
        self.level = dict(changes).get(self._line, self.level)
        self._gpio.set(changes)

    def get(self, line: int) -> int:
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self._gpio.edges()


class Client:
    """One connection to each socket, and what it waits for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.lease = "none-yet"
        self.seq = 0
        self._id = 0
        #: Requests that were not answered, by id.
        self.waiting: dict[int, dict[str, Any]] = {}
        self._control, self._frames = self._connected()
        self._reader = Reader(b"ROUTER", 1_000_000)

    def _connected(self) -> tuple[socket.socket, socket.socket]:
        made = []
        for name, kind in (("control", "DEALER"), ("frames", "PUSH")):
            connection = connected(self._folder / f"{name}.sock")
            poured(connection, hello(kind))
            made.append(connection)
        return made[0], made[1]

    def come_again(self) -> None:
        """Whatever it waited for it gets no more."""
        self.close()
        self.waiting.clear()
        self._control, self._frames = self._connected()
        self._reader = Reader(b"ROUTER", 1_000_000)

    def ask(self, request: dict[str, Any]) -> None:
        self._id += 1
        data = part(json.dumps({**request, "id": self._id}).encode())
        assert poured(self._control, data) == len(data)
        self.waiting[self._id] = request

    def stream(self, request: dict[str, Any]) -> None:
        poured(self._frames, part(json.dumps(request).encode()))

    def answers(self) -> list[tuple[dict[str, Any], dict[str, Any]]]:
        """Each request that was answered, with its reply."""
        try:
            self._reader.feed(self._control.recv(1_000_000))
        except BlockingIOError:
            return []
        found = []
        while (taken := self._reader.take()) is not None:
            if taken[0] is not None:
                reply = json.loads(taken[0][-1])
                assert reply["id"] in self.waiting, f"a second reply, or to nothing: {reply}"
                found.append((self.waiting.pop(reply["id"]), reply))
        return found

    def close(self) -> None:
        self._control.close()
        self._frames.close()


class TwoClients:
    """See the module."""

    def __init__(self) -> None:
        self._temporary = tempfile.TemporaryDirectory(prefix="etd-")
        self._folder = Path(self._temporary.name) / "run"
        self._folder.mkdir(mode=0o750)
        loaded = fake_config(board=BOARD, electrodes=ELECTRODES)
        hv_enable = loaded.board.guards.hv_enable
        assert hv_enable != "absent"
        self._hv_on = hv_enable.on
        body = even_skin(loaded.board, ELECTRODES)
        accounted, self._witness = AccountedBody(body), Witness(body)
        self.rig = engine_rig.make(
            loaded=loaded,
            body=accounted,
            wrap=lambda backend: self._watched(self._witness.wrap(backend), hv_enable.line),
            is_traced=False,
        )
        self.rig.is_gateway_alive = False
        self.rig.engine.components.gateway_link.hang_up()
        self.judge = Judge(self.rig, self._witness, accounted)
        self._listener = Listener(self._folder)
        self._ends: Sequence[Channel[Any]] = ()
        self._gateway_ns = 0
        self._gateway = self._made_gateway()
        self._lease_before: Lease | None = None
        #: What was answered last.
        self._is_refused = False
        #: Of all leases that were granted, the last.
        self._granted = "none-yet"
        self.run(20)
        self.clients = (Client(self._folder), Client(self._folder))
        self.run(10)

    def _watched(self, backend: Backend, line: int) -> Backend:
        self._gpio = _WatchedGpio(backend.gpio, line)
        return replace(backend, gpio=self._gpio)

    def _made_gateway(self) -> Gateway:
        state = self._folder.parent / "state"
        config = GatewayConfig(name="two", runtime_folder=self._folder, state_dir=state)
        return Gateway(config, self.rig.clock, self._read_clocks, reader=read_in_place(config))

    def _read_clocks(self) -> tuple[int, int, int]:
        now_ns = self.rig.clock.now_ns()
        return now_ns, _WALL_NS + now_ns, 0

    # --- verbs ------------------------------------------------------------------------------------

    def ask(self, who: int, op: str, **fields: Any) -> None:
        """A request. With `lease`, it is that of this client, or of the other one."""
        if op in ("arm", "measure"):
            self.judge.probes()
        elif op == "clear":
            self.judge.clears()
        elif op == "open":
            self.judge.opened(Limits(**fields["limits"]))
        if op in OF_LEASE:
            fields = {"lease": self.clients[who].lease, **fields}
        self.clients[who].ask({"op": op, **fields})
        self.run(5)

    def frame(self, who: int, of: int, is_streamed: bool, fields: dict[str, Any]) -> None:
        """With the lease of client `of`."""
        client = self.clients[who]
        client.seq += 1
        request = {"op": "frame", "lease": self.clients[of].lease, "seq": client.seq, **fields}
        (client.stream if is_streamed else client.ask)(request)
        self.run(5)

    def stop(self, who: int) -> None:
        """Until it is answered: where there is an engine, it is halted then."""
        self.ask(who, "stop")
        until_ns = self.rig.clock.now_ns() + _STOPS_WITHIN_NS
        while any(request["op"] == "stop" for request in self.clients[who].waiting.values()):
            assert self.rig.clock.now_ns() < until_ns, "a stop that is not answered"
            self.run(1)
        assert self.rig.state == "HALTED" or self._is_refused

    def run(self, duration_ms: int) -> None:
        until_ns = self.rig.clock.now_ns() + duration_ms * MS
        while self.rig.clock.now_ns() < until_ns:
            self._turn()
            self._look()

    def stall(self, duration_ms: int) -> None:
        """Nothing of the daemon gets a processor for so long."""
        self.rig.clock.spend(duration_ms * MS)
        self.run(5)

    def press(self, line: StopName) -> None:
        self.rig.fake.world.press(line)
        self.run(5)
        assert self.rig.state in ("SAFE", "HALTED"), "a stop line is open"

    def release(self, line: StopName) -> None:
        self.rig.fake.world.release(line)
        self.run(5)

    def put_in(self, fault: Fault) -> None:
        self.judge.is_whole = False
        self.rig.fake.world.put_in(fault)
        self.run(20)

    def mend(self) -> None:
        self.rig.fake.world.mend()
        self.run(5)

    def come_again(self, who: int) -> None:
        """A client's connections end, and it connects anew; its lease it still knows."""
        self.clients[who].come_again()
        self.run(5)

    def gateway_again(self) -> None:
        """The gateway ends, and another one comes."""
        self._gateway.close()
        self.run_engine_alone(5)
        assert self.rig.state in ("SAFE", "HALTED"), "no gateway is there"
        self._gateway = self._made_gateway()
        for client in self.clients:
            client.come_again()
        self.run(300)

    def run_engine_alone(self, turns: int) -> None:
        for _ in range(turns):
            self.rig.step()
            self.judge.look()

    # --- turns and judgments ----------------------------------------------------------------------

    def _turn(self) -> None:
        now_ns = self.rig.clock.now_ns()
        if now_ns - self._gateway_ns >= _GATEWAY_NS:
            self._gateway_ns = now_ns
            self._gateway.step(0)
        engine = self.rig.engine
        if not engine.has_gateway:
            channels = self._listener.accept()
            if channels is not None:
                for end in self._ends:
                    end.close()
                self._ends = channels
                engine.attach(*channels)
        self.rig.step()

    def _look(self) -> None:
        self.judge.look()
        self._look_at_lease()
        if self.rig.state in ("SAFE", "HALTED"):
            assert self._gpio.level != self._hv_on, f"the supply is on in {self.rig.state}"
        for client in getattr(self, "clients", ()):
            for request, reply in client.answers():
                self._judge_reply(client, request, reply)

    def _look_at_lease(self) -> None:
        """From one holder to another it goes through nobody, or after the time of the first."""
        lease, before = self.rig.engine.supervisor.lease, self._lease_before
        if lease is not None and before is not None and lease.token != before.token:
            assert before.has_lapsed(self.rig.clock.now_ns()), "a lease was taken from its holder"
        self._lease_before = lease

    def _judge_reply(self, client: Client, request: dict[str, Any], reply: dict[str, Any]) -> None:
        op = request["op"]
        assert reply["ok"] or reply["reason"], "a refusal has a reason"
        self._is_refused = not reply["ok"]
        if not reply["ok"]:
            return
        if op == "open":
            assert reply["lease"] != self._granted
            self._granted = client.lease = reply["lease"]
            client.seq = 0
        elif "lease" in request and op != "account":
            # An account may be had of the lease that ended last, too.
            assert request["lease"] == self._granted, f"{op} with a lease that has ended"

    def end(self) -> None:
        """All that was asked is answered; then the daemon ends, and the board is safe."""
        try:
            until_ns = self.rig.clock.now_ns() + _LAST_REPLY_NS
            while any(client.waiting for client in self.clients):
                waiting = [client.waiting for client in self.clients]
                assert self.rig.clock.now_ns() < until_ns, f"never answered: {waiting}"
                self.run(10)
            self.run(10)
        finally:
            problems = self.close()
        self.judge.end(problems)

    def close(self) -> tuple[str, ...]:
        problems = self.rig.close()
        self._gateway.close()
        for client in self.clients:
            client.close()
        for end in self._ends:
            end.close()
        self._listener.close()
        self._temporary.cleanup()
        return problems
