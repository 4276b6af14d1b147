"""One scene: an engine on the stepped fake, and what a scene may do to it.

Owns: the verbs of a scene, and the record that is left of it: the bus trace as the fake wrote it,
and every message of the engine to its gateway. Must not know: which scenes there are, what a
record is compared with.

A scene decides nothing by what it sees: an engine that answers otherwise plays the same scene, and
the records show where the two part.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

import engine_rig
from engine_rig import LEASE
from etd.files.configuration import LoadedConfig
from etd.protocol.calibration import Calibration
from etd.protocol.link import (
    Answer,
    ArmBoard,
    ClearHalt,
    CloseLease,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    OpenLease,
    SetMark,
    StopNow,
)
from etd.protocol.messages import Limits
from etd_body.electrode import skin
from etd_hal.bench import StopName
from etd_hal.fake.faults import Fault
from etd_hal.fake.world import Touchable

_MS = 1_000_000
#: A command that is not answered within so long is left alone.
_PATIENCE_MS = 3_000


@dataclass(frozen=True)
class Record:
    """What a scene left: `trace` as bytes, and the engine's messages in their order, as objects."""

    trace: bytes
    told: tuple[dict[str, Any], ...]


class Stage:
    """See the module."""

    def __init__(
        self, loaded: LoadedConfig, body: Touchable | None = None, faults: Sequence[Fault] = ()
    ) -> None:
        self.rig = engine_rig.make(loaded=loaded, body=body, faults=faults)
        self.count = loaded.array.count
        self._told: list[dict[str, Any]] = []

    # --- commands ----------------------------------------------------------------------------

    def open(
        self,
        max_current_ua: int = 3_000,
        width_us: int = 200,
        calibration: Calibration | None = None,
    ) -> None:
        limits = Limits(max_current_ua=max_current_ua, width_us=width_us)
        self._ask(
            OpenLease,
            lease=LEASE,
            client="scene",
            limits=None if calibration is not None else limits,
            calibrations=() if calibration is None else self.rig.wanted(calibration),
        )

    def arm(self) -> None:
        """The wearer's stop is tried first, where there is one."""
        if self.rig.engine.components.loaded.board.guards.wearer_stop != "absent":
            self.press("wearer_stop")
            self.run(5)
            self.release("wearer_stop")
            self.run(5)
        self._ask(ArmBoard)

    def ready(self, max_current_ua: int = 3_000, calibration: Calibration | None = None) -> None:
        self.open(max_current_ua, calibration=calibration)
        self.arm()

    def measure(self) -> None:
        self._ask(MeasureContact, lease=LEASE)

    def disarm(self) -> None:
        self._ask(DisarmBoard, lease=LEASE)

    def close_lease(self) -> None:
        self._ask(CloseLease, lease=LEASE)

    def keep(self) -> None:
        self._ask(KeepLease, lease=LEASE)

    def stop(self) -> None:
        self._ask(StopNow, client="operator")

    def clear(self) -> None:
        self._ask(ClearHalt)

    def mark(self, tag: int) -> None:
        self._ask(SetMark, lease=LEASE, tag=tag)

    # --- frames ------------------------------------------------------------------------------

    def show(self, **fields: Any) -> None:
        """One frame, and its answer."""
        self._wait_for(self.rig.send(**fields))

    def hold(self, duration_ms: int, **fields: Any) -> None:
        """The same frame every 60 ms."""
        until_ns = self.rig.clock.now_ns() + duration_ms * _MS
        while (left_ns := until_ns - self.rig.clock.now_ns()) > 0:
            self.show(**fields)
            self.run(min(60.0, left_ns / _MS))

    def send(self, **fields: Any) -> None:
        """One frame; its answer is not waited for."""
        self.rig.send(**fields)

    # --- the world ---------------------------------------------------------------------------

    def run(self, duration_ms: float) -> None:
        self.rig.run_ms(duration_ms)

    def stall(self, duration_ms: int) -> None:
        """The engine gets no processor for so long."""
        self.rig.clock.spend(duration_ms * _MS)

    def at(self, delay_us: int, action: Callable[[], object]) -> None:
        """Something that happens so long from now, whatever the engine does then."""
        self.rig.clock.at(self.rig.clock.now_ns() + delay_us * 1_000, action)

    def put_in(self, fault: Fault) -> None:
        self.rig.fake.world.put_in(fault)

    def take_out(self, fault: Fault) -> None:
        self.rig.fake.world.take_out(fault)

    def press(self, line: StopName) -> None:
        if getattr(self.rig.engine.components.loaded.board.guards, line) != "absent":
            self.rig.fake.world.press(line)

    def release(self, line: StopName) -> None:
        if getattr(self.rig.engine.components.loaded.board.guards, line) != "absent":
            self.rig.fake.world.release(line)

    def lift(self, electrode: int) -> None:
        self.rig.fake.world.lift(electrode)

    def touch(self, electrode: int) -> None:
        self.rig.fake.world.touch(electrode, skin())

    def silence_gateway(self) -> None:
        self.rig.is_gateway_alive = False

    # --- the record --------------------------------------------------------------------------

    def end(self) -> Record:
        """The engine's end, and what is left of the scene."""
        self.run(40)
        problems = self.rig.close()
        told = [_plain(message) for message in (*self.rig.others, *self.rig.reports)]
        told += self._told
        told.append({"type": "End", "problems": list(problems)})
        return Record(self.rig.sink.getvalue(), tuple(told))

    def _ask(self, kind: Callable[..., Any], **fields: Any) -> None:
        ref = self.rig.next_ref()
        self.rig.commands.send(kind(ref=ref, **fields))
        self._wait_for(ref)

    def _wait_for(self, ref: int) -> None:
        until_ns = self.rig.clock.now_ns() + _PATIENCE_MS * _MS
        while ref not in self.rig.answers and self.rig.clock.now_ns() < until_ns:
            self.rig.step()
        answer = self.rig.answers.pop(ref, None)
        self._told.append({"type": "NoAnswer", "ref": ref} if answer is None else _plain(answer))


def _plain(message: object) -> dict[str, Any]:
    """As JSON has it, with the name of what it is."""
    kind = "Answer" if isinstance(message, Answer) else type(message).__name__
    fields: dict[str, Any] = json.loads(msgspec.json.encode(message))
    return {**fields, "type": kind}
