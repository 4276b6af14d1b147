"""What a client does with an engine, step by step, however the engine answers.

Owns: the rig, commands and frames of a scripted client and gateway, and what the engine said of a
fault. Must not know: the scenes' order of steps, faults.
"""

from __future__ import annotations

import io
from collections.abc import Callable

from campaign.account import AccountedBody, Course
from campaign.operations import Operations
from campaign.own_memory import link_in_memory
from campaign.scene import Over, Said
from campaign.subject import Subject
from charge_witness import even_skin
from engine_rig import LEASE, EngineRig, rig_on
from engine_scenes import halts
from etd.files.configuration import LoadedConfig
from etd.protocol.link import ArmBoard, KeepLease, LeaseEnded
from etd_hal.errors import EtdError
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock

MS = 1_000_000
ELECTRODES = 8
CURRENT_UA, WIDTH_US = 400, 50
#: Of one pulse and phase.
PULSE_PC = CURRENT_UA * WIDTH_US
LIT = (0, 2, 5)
WANTED_UA = tuple(CURRENT_UA if electrode in LIT else 0 for electrode in range(ELECTRODES))
STOPPED_BY = "the script"
#: The slowest check while armed comes each second, and a frame may be under way.
LONG_MS, SHORT_MS = 1_150, 60
#: Why the engine ends a lease that its client has not closed.
_BY_ITSELF = frozenset({"lapsed", "the gateway is silent"})
#: What a stop says besides, where the board could not be made safe by it.
_NOT_SAFE = (" failed (", " when read back: ")
#: As a client does while it waits.
_KEEP_NS = 200 * MS
#: Longer than what comes before arming differs by.
_BEAT_NS = 300 * MS
#: Longer than arming takes without a fault, where no relays are waited for; with a fault that slows
#: it, what follows comes later by as much.
ARMED_NS = 150 * MS


class EngineScript:
    """See the module; a scene is made of it."""

    #: Of a pulse of its frames.
    current_ua, width_us = CURRENT_UA, WIDTH_US

    def __init__(
        self, loaded: LoadedConfig, operations: Operations, course: Course | None = None
    ) -> None:
        self._loaded, self._operations = loaded, operations
        clock = SteppedClock()
        body = AccountedBody(even_skin(loaded.board, ELECTRODES), course)
        fake = FakeBoard(loaded.board, clock, body, electrodes=loaded.array.outputs())
        self.subject = Subject(fake, clock, body)
        #: Why it did not begin.
        self._refused = ""
        self._is_killed = False
        #: A supply that was on for nothing, before it was wanted again.
        self._was_left_on = False

    @property
    def pulse_pc(self) -> int:
        """Of one phase."""
        return self.current_ua * self.width_us

    @property
    def wanted_ua(self) -> tuple[int, ...]:
        """By electrode, in its frames."""
        return tuple(self.current_ua if electrode in LIT else 0 for electrode in range(ELECTRODES))

    @property
    def rig(self) -> EngineRig:
        assert self.subject.rig is not None
        return self.subject.rig

    def power_up(self) -> None:
        """Up to the first safe state, with a gateway attached. Raises: Over, where it did not
        begin.
        """
        subject = self.subject
        try:
            rig = rig_on(
                self._loaded, subject.fake, subject.clock, io.BytesIO(), self._operations.wrap
            )
        except EtdError as error:
            self._refused = str(error)
            raise Over from None
        link_in_memory(rig)
        subject.rig = rig

    @property
    def leaves_supply_on(self) -> bool:
        rig = self.subject.rig
        is_wanted = not self._is_killed and rig is not None and rig.engine.supervisor.is_powered
        return self._was_left_on or (self.subject.fake.world.is_supply_enabled and not is_wanted)

    def note_supply(self) -> None:
        """What is left on by now, whatever comes later."""
        self._was_left_on = self.leaves_supply_on

    def step(self) -> None:
        """Raises: Over, once it has halted by a fault."""
        self.rig.step()
        halt = self.rig.engine.supervisor.states.halt
        if halt is not None and halt.cause == "fault":
            raise Over

    def run_ms(self, duration_ms: float) -> None:
        until_ns = self.rig.clock.now_ns() + int(duration_ms * 1e6)
        while self.rig.clock.now_ns() < until_ns:
            self.step()

    def ask(self, kind: Callable[..., object], **fields: object) -> None:
        """A command; whatever the answer is, or none in a second, the script goes on."""
        rig = self.rig
        if not self.subject.is_client_alive:
            return
        ref = rig.next_ref()
        rig.commands.send(kind(ref=ref, **fields))
        until_ns = rig.clock.now_ns() + 1_000 * MS
        keep_ns = rig.clock.now_ns() + _KEEP_NS
        while ref not in rig.answers and rig.clock.now_ns() < until_ns:
            self.step()
            if rig.clock.now_ns() >= keep_ns and self.subject.is_client_alive:
                keep_ns += _KEEP_NS
                rig.commands.send(KeepLease(lease=LEASE))

    def wait_for_beat(self, begun_ns: int = 0, beat_ns: int = _BEAT_NS) -> None:
        """Until the next of the beats that have begun then, with the lease kept."""
        passed = (self.rig.clock.now_ns() - begun_ns) // beat_ns
        until_ns = begun_ns + (passed + 1) * beat_ns
        if self.subject.is_client_alive:
            self.rig.commands.send(KeepLease(lease=LEASE))
        while self.rig.clock.now_ns() < until_ns:
            self.step()

    def send(self, **fields: object) -> None:
        if self.subject.is_client_alive:
            asked = {"current_ua": self.wanted_ua, "width_us": self.width_us}
            self.rig.send(**{**asked, **fields})

    def hold(self, duration_ms: float, **fields: object) -> None:
        """The same frame without a gap."""
        until_ns = self.rig.clock.now_ns() + int(duration_ms * 1e6)
        while (left_ns := until_ns - self.rig.clock.now_ns()) > 0:
            self.send(**{"rate_hz": 40.0, "ttl_ms": 100, **fields})
            self.run_ms(min(50.0, left_ns / 1e6))

    def try_wearer_stop(self) -> None:
        """As before the first arming, where there is one."""
        if self._loaded.board.guards.wearer_stop != "absent":
            self.subject.fake.world.press("wearer_stop")
            self.run_ms(5)
            self.subject.fake.world.release("wearer_stop")
            self.run_ms(5)

    def insist(self) -> None:
        """After its halt: it must neither arm nor show anything."""
        rig = self.subject.rig
        if rig is None or rig.state != "HALTED":
            return
        rig.commands.send(ArmBoard(ref=0))
        rig.send(current_ua=self.wanted_ua, width_us=self.width_us, rate_hz=40.0, ttl_ms=100)
        rig.run_ms(20)

    def after_kill(self) -> None:
        """The keeper cuts, if it still looks, and the lines stay."""
        self._is_killed = True
        if self.subject.rig is not None and self.rig.stopper.is_looking:
            self.rig.stopper.end()
        self.subject.clock.spend(100 * MS)

    def said(self, begun_ns: int) -> Said:
        if self._refused:
            return Said("refused", None, self._refused)
        if self.subject.rig is None:
            return Said("nothing")
        self.rig.listen()
        halt = self.rig.engine.supervisor.states.halt
        told = [
            one
            for one in (*halts(self.rig), *((halt,) if halt else ()))
            if one.cause == "fault" or any(part in one.detail for part in _NOT_SAFE)
        ]
        if told:
            first = told[0]
            return Said("halted", (first.t_ns - begun_ns) / MS, f"{first.source}: {first.detail}")
        if reason := self._first_refusal():
            return Said("refused", None, reason)
        return Said("made safe" if self._is_safe_by_itself() else "nothing")

    def problem(self) -> str | None:
        said = self.said(0)
        return None if said.seen == "nothing" else f"{said.seen}: {said.why}"

    def close(self) -> None:
        if self.subject.rig is not None:
            self.subject.rig.close()

    def _first_refusal(self) -> str:
        for answer in self.rig.answers.values():
            if answer.error is not None:
                return f"{answer.error}: {answer.reason}"
        return ""

    def _is_safe_by_itself(self) -> bool:
        """Without the client's wish: its lease lapsed, or the gateway went."""
        ended = [message.reason for message in self.rig.others if isinstance(message, LeaseEnded)]
        return not self.rig.engine.has_gateway or not _BY_ITSELF.isdisjoint(ended)


def lease_of(**fields: object) -> dict[str, object]:
    return {"lease": LEASE, "client": "campaign", **fields}
