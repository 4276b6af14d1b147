"""An engine that speaks the link and does what a test tells it to.

Owns: accepting the gateway, greeting it, keeping what it was told, and answering. Must not know:
ZeroMQ, boards, time.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from etd.protocol.facts import ArrayFacts, BoardFacts, MaximaFacts
from etd.protocol.felt import FeltDone
from etd.protocol.link import (
    Alive,
    Answer,
    AskAccount,
    Channel,
    Command,
    EngineHello,
    Listener,
    MeasureContact,
    NewFrame,
    OpenLease,
    Report,
    SayFelt,
    SetMark,
    ToEngine,
    ToGateway,
)
from etd.protocol.messages import Contact, Halt, State, StateReport
from etd.protocol.opening import LeaseCalibration
from etd.protocol.outcome import Account

ELECTRODES = 4


def engine_hello(backend: str = "fake") -> EngineHello:
    """Four electrodes in a row."""
    return EngineHello(
        board=BoardFacts(
            name="scripted",
            backend=backend,
            machine="rig",
            full_scale_ua=10_000,
            resolution_ua=2.442,
            leak_ohm=4_700_000,
            compliance_v=300,
            rest_us=200,
            states=("ANODE", "CATHODE"),
            present_guards=("hv_enable",),
            absent_guards=("one_shot",),
        ),
        array=ArrayFacts(
            name="row-4",
            electrodes=ELECTRODES,
            x_mm=(0.0, 2.5, 5.0, 7.5),
            y_mm=(0.0, 0.0, 0.0, 0.0),
            diameter_mm=1.0,
        ),
        body_site="fingertip",
        maxima=MaximaFacts(
            current_ua=10_000,
            uncalibrated_current_ua=3_000,
            width_us=200,
            charge_nc=500.0,
            rate_hz=120.0,
            mean_current_ua=30,
            array_mean_current_ua=2_000,
            probe_current_ua=500,
        ),
        default_width_us=100,
        default_rate_hz=60.0,
        default_polarity="anodic",
    )


def account(seq: int, **changes: Any) -> Account:
    """Of a frame that fired the first electrode as it was asked to."""
    made = Account(
        seq=seq,
        tag=None,
        ended="replaced",
        rate_hz=60.0,
        begun_ns=1_000 * seq,
        first_ns=1_000 * seq,
        last_ns=1_000 * seq + 500,
        pulses=(6, 0, 0, 0),
        wanted_ua=(2_000, 0, 0, 0),
        least_ua=(1_998, 0, 0, 0),
        most_ua=(1_998, 0, 0, 0),
        delivered_ua=(1_900, 0, 0, 0),
    )
    return msgspec.structs.replace(made, **changes)


#: As that of a body site that raises nothing.
NOT_RAISED = FeltDone(did="nothing", reason="nothing is raised here")


def full_answer(message: Command | NewFrame) -> Answer:
    """Yes to everything, with what each kind of answer has to carry."""
    if isinstance(message, NewFrame):
        return Answer(ref=message.ref, rate_hz=60.0)
    if isinstance(message, AskAccount):
        return Answer(ref=message.ref, account=account(message.seq))
    if isinstance(message, MeasureContact):
        contact = Contact(
            contact=(True, True, False, None),
            resistance_ohm=(50_000, 48_000, None, None),
            voltage_v=(25.0, 24.0, 290.0, None),
            t_ns=1,
        )
        return Answer(ref=message.ref, contact=contact)
    if isinstance(message, OpenLease):
        taken = tuple(
            LeaseCalibration(name=it.name, polarity="anodic", digest=it.digest or "")
            for it in message.calibrations
        )
        return Answer(ref=message.ref, calibrations=taken)
    if isinstance(message, SetMark):
        return Answer(ref=message.ref, marked_ns=42, sync=False)
    if isinstance(message, SayFelt):
        did = FeltDone(did="lowered") if message.answer == "too_strong" else NOT_RAISED
        return Answer(ref=message.ref, felt=did)
    return Answer(ref=message.ref)


class ScriptedEngine:
    """Stepped by `turn`. `answer` decides what is answered; None says nothing."""

    def __init__(self, folder: Path, facts: EngineHello | None = None) -> None:
        self._listener = Listener(folder)
        self._channels: tuple[Channel[ToEngine], Channel[NewFrame]] | None = None
        self._facts = facts or engine_hello()
        self.is_running = True
        self.state: State = "SAFE"
        self.answer: Callable[[Command | NewFrame], Answer | None] = full_answer
        self.is_reading = True
        self.heard: list[Command | NewFrame] = []
        self.alive = 0

    def step(self) -> None:
        """Accept, greet, read everything, answer it. Nothing, once closed."""
        if not self.is_running:
            return
        if self._channels is None:
            self._channels = self._listener.accept()
            if self._channels is None:
                return
            self.say(self._facts)
            self.report_state()
        if not self.is_reading:
            return
        # A test may hang up meanwhile, from its own thread.
        channels = self._channels or ()
        for channel in channels:
            while (message := channel.receive()) is not None:
                self._hear(message)
        if not all(channel.is_open for channel in channels):
            self.hang_up()

    def _hear(self, message: Command | NewFrame) -> None:
        if isinstance(message, Alive):
            self.alive += 1
            return
        self.heard.append(message)
        answer = self.answer(message)
        if answer is not None and message.ref:
            self.say(answer)

    @property
    def is_connected(self) -> bool:
        return self._channels is not None

    @property
    def frames(self) -> list[NewFrame]:
        return [message for message in self.heard if isinstance(message, NewFrame)]

    @property
    def leases(self) -> list[OpenLease]:
        return [message for message in self.heard if isinstance(message, OpenLease)]

    @property
    def frames_end(self) -> Channel[NewFrame]:
        """Where frames come in, for who reads them in the place of `step`."""
        assert self._channels is not None
        return self._channels[1]

    def say(self, message: ToGateway) -> None:
        assert self._channels is not None
        assert self._channels[0].send(message)

    def report_state(self, *, halt: Halt | None = None, **counters: int) -> None:
        state = StateReport(
            state=self.state, now_ns=7, engine="there", counters=counters, halt=halt
        )
        self.say(Report(state=state))

    def hang_up(self) -> None:
        """As a kill does: both connections end."""
        for channel in self._channels or ():
            channel.close()
        self._channels = None

    def close(self) -> None:
        """As the end of the process. Idempotent."""
        if self.is_running:
            self.is_running = False
            self.hang_up()
            self._listener.close()
