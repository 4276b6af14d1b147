"""An engine that is told a record's timeline, pulse by pulse in the record's time.

Owns: the engine's link and clock, and what each pulse is to measure. Must not know: files, how
pulses are compared.

The engine computes in no time here, so its clock waits for the record's next pulse; where the
engine itself is later than the record was, nothing can be done, and the comparison tells.
"""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Iterator
from typing import Self

import msgspec

from etd.engine.loop import Engine
from etd.engine.opening import GivenCalibrations
from etd.files.configuration import LoadedConfig
from etd.protocol.calibration import Calibration
from etd.protocol.carried import CarriedOver
from etd.protocol.errors import Refused
from etd.protocol.felt import FeltFacts
from etd.protocol.frame import Frame
from etd.protocol.link import (
    Alive,
    Answer,
    ArmBoard,
    Channel,
    ClearHalt,
    CloseLease,
    Command,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    NewFrame,
    OpenLease,
    PulseBatch,
    RecordPulses,
    Report,
    SayFelt,
    StopNow,
    ToEngine,
    ToGateway,
)
from etd.protocol.messages import Halt
from etd.protocol.opening import WantedCalibration
from etd.protocol.pulse_row import PulseRow, rows_of
from etd.record.lines import LeaseBegun
from etd.replay.timeline import Act, Told
from etd_hal.backend import ReplayStage
from etd_hal.stopper import Stopper

_LEASE = _STOPPED_BY = "replay"
#: As often as a gateway says that it is there, and the lease is renewed.
_ALIVE_NS = 50_000_000
#: The clock is moved in steps that are no stall for the engine.
_STEP_NS = 5_000_000
#: No pause within a scan is longer than a poll may be late.
_PAUSE_NS = 45_000_000
_SHOWN_MS = 1_000


class ReplayEngine:
    """Use in a `with` block. `refused`: what the engine did not accept, a sentence each."""

    def __init__(self, loaded: LoadedConfig, stage: ReplayStage) -> None:
        """Raises: ValueError, for a real board: what a record carries over is not its person's."""
        if stage.backend.name != "fake":
            raise ValueError("a record is replayed on a fake board only")
        #: Of the lease that is opened next, by the names that it is opened with here.
        self._calibrations: dict[str, Calibration] = {}
        given = GivenCalibrations(self._calibrations)
        self.engine = Engine(loaded, stage.backend, calibrations=given)
        self.refused: list[str] = []
        # The engine's own, which counts what is waited here as rest.
        self._clock = self.engine.components.clock
        self._samples, self._at = stage.samples, stage.at
        self._alive_ns = 0
        #: When something will be told.
        self._upcoming_ns: deque[int] = deque()
        #: Something that the engine has not heeded yet.
        self._is_told = False
        self._told_act: Act | None = None
        #: What the record's time is ahead of this clock.
        self._ahead_ns: int | None = None
        pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)]
        self._ends: tuple[Channel[ToEngine], Channel[NewFrame]] = (
            Channel(pairs[0][0], ToEngine),
            Channel(pairs[1][0], NewFrame),
        )
        self._commands: Channel[ToGateway] = Channel(pairs[0][1], ToGateway)
        self._frames: Channel[ToGateway] = Channel(pairs[1][1], ToGateway)

    def __enter__(self) -> Self:
        """Raises: BoardFault, BusError."""
        board = self.engine.components.board
        self._stopper = Stopper(board.cut.words, self._clock.now_ns, board.blank_now)
        # It looks as soon as it is woken.
        self.engine.supervisor.supply.watched = lambda _: self._stopper.check()
        self.engine.supervisor.begin()
        self.engine.attach(*self._ends)
        self._commands.send(RecordPulses(is_on=True))
        return self

    def __exit__(self, *_: object) -> None:
        self.engine.supervisor.end()
        for channel in (*self._ends, self._commands, self._frames):
            channel.close()

    def until(self, t_ns: int, expected: PulseRow | None) -> Iterator[PulseRow]:
        """Let the engine run until that time of the record, or until it has fired the pulse that is
        `expected` next. Yields what was fired.
        """
        until_ns = self._here_ns(t_ns)
        while self._clock.now_ns() < until_ns:
            self._wait_for(until_ns, expected)
            for row in self._step(expected):
                yield row
                if expected is not None and row.electrode == expected.electrode:
                    return

    def tell(self, told: Told) -> None:
        """Once its time comes, in the middle of a wait too."""
        at_ns = self._here_ns(told.t_ns)
        self._upcoming_ns.append(at_ns)
        self._at(at_ns, lambda: self._send(told))

    def _here_ns(self, t_ns: int) -> int:
        """That time of the record by the clock here. The first one is a little ahead of now."""
        if self._ahead_ns is None:
            self._ahead_ns = t_ns - self._clock.now_ns() - _ALIVE_NS
        return t_ns - self._ahead_ns

    def _send(self, told: Told) -> None:
        self._upcoming_ns.popleft()
        self._is_told, self._told_act = True, told.act
        if told.act == "frame":
            self._show(told)
            return
        if told.carried is not None:
            self._resume(told.carried)
            return
        if told.felt is not None:
            self._commands.send(_said(told.felt))
            return
        if told.act == "open" and self.engine.supervisor.lease is not None:
            self._commands.send(CloseLease(ref=1, lease=_LEASE))
        if told.act == "open":
            self._calibrations.clear()
            self._calibrations.update(_calibrations_of(told.lease))
        self._commands.send(_command(told))

    def _resume(self, carried: CarriedOver) -> None:
        parts, ahead_ns = self.engine.components, self._ahead_ns or 0
        parts.soft_start.resume(carried.soft_start, ahead_ns)
        if carried.contacts is not None:
            parts.contact.resume(carried.contacts, ahead_ns)
        parts.source_check.checked_ns = carried.source_checked_ns - ahead_ns

    def _show(self, told: Told) -> None:
        request, now_ns = told.request or {}, self._clock.now_ns()
        until_ns = self._here_ns(told.until_ns)
        fields = {key: value for key, value in request.items() if key not in ("op", "account")}
        fields |= {
            "lease": _LEASE,
            "ttl_ms": _SHOWN_MS,
            "sent_ns": min(now_ns, until_ns - _SHOWN_MS * 1_000_000),
        }
        frame = msgspec.convert(fields, Frame)
        if not self._frames.send(NewFrame(ref=0, frame=frame)):
            raise Refused("busy", "the engine does not read its frames")

    def _wait_for(self, until_ns: int, expected: PulseRow | None) -> None:
        """Not for longer than an engine may be without a poll, and not before it has heeded what it
        was told.
        """
        if self._is_told:
            self._is_told = False
            return
        now_ns, target_ns = self._clock.now_ns(), until_ns
        if expected is not None:
            target_ns = min(target_ns, self._here_ns(expected.asked_ns))
        schedule = self.engine.components.active.schedule
        if schedule is not None and self.engine.is_between_scans:
            # What a scan begins with, a check of the source at times, comes before its pulses.
            target_ns = min(target_ns, schedule.next_ns)
        if self._upcoming_ns:
            # The engine is to find it at once, and not when a wait is over.
            target_ns = min(target_ns, self._upcoming_ns[0])
            if self._would_wait_beyond(self._upcoming_ns[0], now_ns):
                target_ns = self._upcoming_ns[0]
        if target_ns > now_ns:
            # Within a scan the next pulse is not due earlier.
            most_ns = _STEP_NS if self.engine.is_between_scans else _PAUSE_NS
            self._clock.sleep_until_ns(min(target_ns, now_ns + most_ns))
            if self._told_act in ("arm", "measure"):
                # The step that follows heeds it whole, and a pulse may be due after it.
                self._is_told = False

    def _would_wait_beyond(self, t_ns: int, now_ns: int) -> bool:
        """An engine with nothing to do may wait for a tick without heeding a message."""
        if not self.engine.is_between_scans or t_ns - now_ns > _STEP_NS:
            return False
        schedule = self.engine.components.active.schedule
        return schedule is None or schedule.next_ns > t_ns

    def _step(self, expected: PulseRow | None) -> Iterator[PulseRow]:
        if expected is not None:
            self._samples.expect(
                expected.electrode, expected.samples_v, has_prepulse=expected.prepulse_ua > 0
            )
        self._stay_alive()
        self._stopper.check()
        self.engine.step()
        self.engine.components.pulse_log.send_off()
        for row in self._fired():
            yield msgspec.structs.replace(row, t_ns=row.t_ns + (self._ahead_ns or 0))

    def _fired(self) -> Iterator[PulseRow]:
        while (message := self._commands.receive()) is not None:
            if isinstance(message, PulseBatch):
                yield from rows_of(message.rows)
            elif isinstance(message, Answer) and message.error is not None:
                self.refused.append(message.reason)
            elif isinstance(message, Report) and message.halt is not None:
                self._heed_halt(message.halt)
            elif isinstance(message, Report) and message.refused is not None:
                self.refused.append(message.refused.reason)
        while self._frames.receive() is not None:
            pass

    def _heed_halt(self, halt: Halt) -> None:
        """One that the record has not."""
        if halt.source != _STOPPED_BY:
            self.refused.append(f"it halted by {halt.cause} ({halt.source}): {halt.detail}")

    def _stay_alive(self) -> None:
        now_ns = self._clock.now_ns()
        if now_ns >= self._alive_ns:
            self._alive_ns = now_ns + _ALIVE_NS
            has_lease = self.engine.supervisor.lease is not None
            self._commands.send(KeepLease(lease=_LEASE) if has_lease else Alive())


def _said(felt: FeltFacts) -> SayFelt:
    answer = felt.answer or "good"
    lease = None if felt.lowers_only else _LEASE
    return SayFelt(ref=1, answer=answer, electrodes=felt.electrodes, lease=lease)


def _calibrations_of(lease: LeaseBegun | None) -> dict[str, Calibration]:
    """In their order; the names are the replay's."""
    if lease is None or lease.calibration is None:
        return {}
    each = (lease.calibration, *(it.calibration for it in lease.others))
    return {f"replay-{number}": calibration for number, calibration in enumerate(each)}


def _command(told: Told) -> Command:
    match told.act:
        case "open":
            lease = told.lease
            return OpenLease(
                ref=1,
                lease=_LEASE,
                client="replay" if lease is None else lease.client or "replay",
                calibrations=tuple(WantedCalibration(name=it) for it in _calibrations_of(lease)),
                limits=None if lease is None else lease.limits,
            )
        case "arm":
            return ArmBoard(ref=1)
        case "measure":
            return MeasureContact(ref=1, lease=_LEASE)
        case "disarm":
            return DisarmBoard(ref=1, lease=_LEASE)
        case "close":
            return CloseLease(ref=1, lease=_LEASE)
        case "stop":
            return StopNow(ref=1, client=_STOPPED_BY)
        case _:
            return ClearHalt(ref=1)
