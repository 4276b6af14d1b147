"""A story told to an engine on the stepped fake, and written down for the oracle.

Owns: the verbs of a story, and what the oracle has to know of each. Must not know: judgments.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

import engine_rig
from engine_oracle import Bounds, SentFrame, Story
from engine_rig import LEASE
from etd.files.body_site import SiteMaxima
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.calibration import Calibration, ElectrodeLimits, currents_of_levels
from etd.protocol.frame import Frame, Returns, Ring
from etd.protocol.link import (
    ArmBoard,
    ClearHalt,
    CloseLease,
    DisarmBoard,
    MeasureContact,
    StopNow,
)
from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.settings import Settings
from etd_body.electrode import skin
from etd_hal.bench import StopName
from etd_hal.fake.faults import RailOff
from etd_hal.ports import Clock

_LEVEL_WIDTH_US, _LEVEL_RATE_HZ = 80, 20.0


class Asker:
    """A stabilizer that asks for what it was told to ask, one wish after another."""

    def __init__(self, requests: Sequence[PulseRequest]) -> None:
        self.requests = requests
        self.clock: Clock | None = None
        self.asked: list[tuple[int, int, int, int]] = []

    max_gain = MaxGain(current=100.0, width=2.0, charge=200.0)

    def reset(self) -> None:
        """Nothing to forget."""

    def adapt(self, pulse_request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        assert self.clock is not None
        mine = self.requests[len(self.asked) % len(self.requests)]
        now_ns = self.clock.now_ns()
        self.asked.append((now_ns, estimate.electrode, mine.current_ua, mine.width_us))
        return mine


@dataclass(frozen=True)
class Setting:
    """A board with electrodes on it, and what nobody gets more of there."""

    board: str
    electrodes: int
    maxima: SiteMaxima
    slot_ns: int
    is_probe_first: bool = False

    def loaded(self) -> LoadedConfig:
        loaded = fake_config(board=self.board, electrodes=self.electrodes)
        site = msgspec.structs.replace(
            loaded.body_site,
            maxima=self.maxima,
            stabilize=Settings(probe_first=self.is_probe_first),
        )
        return LoadedConfig(
            config=loaded.config,
            board=loaded.board,
            machine=loaded.machine,
            array=loaded.array,
            body_site=site,
            source=loaded.source,
        )

    def bounds(self) -> Bounds:
        """By hand: no shipped board allows less than this body site, probes apart."""
        most = self.maxima
        return Bounds(
            charge_pc=most.charge_nc * 1_000,
            rate_hz=most.rate_hz,
            mean_current_ua=most.mean_current_ua,
            on_us_per_s=most.on_us_per_s,
            array_mean_current_ua=most.array_mean_current_ua,
            array_on_us_per_s=most.array_on_us_per_s,
            net_charge_pc=most.net_charge_nc * 1_000,
            probe_current_ua=min(300, most.current_ua),
            probe_width_us=50,
            slot_ns=self.slot_ns,
        )


class Teller:
    """Each verb does something to the engine or its world, whatever state they are in."""

    def __init__(self, setting: Setting, requests: Sequence[PulseRequest] = ()) -> None:
        self._adapter = Asker(requests)
        self.rig = engine_rig.make(
            loaded=setting.loaded(), stabilizers=(self._adapter,) if requests else ()
        )
        self._adapter.clock = self.rig.clock
        self.story = Story(
            setting.bounds(), setting.electrodes, is_probe_first=setting.is_probe_first
        )
        self._look(range(setting.electrodes))
        self._calibration: Calibration | None = None
        self._person = 0

    @property
    def now_ns(self) -> int:
        return self.rig.clock.now_ns()

    def open(self, caps_ua: Sequence[int]) -> None:
        """A lease for somebody with these caps."""
        loaded = self.rig.engine.components.loaded
        calibration = Calibration(
            participant=f"P{self._person}",
            body_site=loaded.body_site.name,
            array=loaded.array.name,
            polarity="anodic",
            width_us=min(_LEVEL_WIDTH_US, loaded.body_site.maxima.width_us),
            rate_hz=min(_LEVEL_RATE_HZ, loaded.body_site.maxima.rate_hz),
            returns="all",
            date=datetime.date(2025, 1, 1),
            program="test",
            shape=loaded.body_site.stabilize.shape,
            electrode=tuple(
                ElectrodeLimits(threshold_ua=cap // 4, comfortable_ua=cap // 2, cap_ua=cap)
                for cap in caps_ua
            ),
        )
        before_ns = self.now_ns
        answer = self.rig.open_with(calibration)
        if answer.error is None:
            self.story.caps.append((before_ns, tuple(caps_ua)))
            self._calibration = calibration

    def close(self) -> None:
        self.rig.ask(CloseLease, lease=LEASE)

    def arm(self) -> None:
        if self.rig.engine.components.loaded.board.guards.wearer_stop != "absent":
            self.press("wearer_stop")
            self.rig.run_ms(3)
            self.release("wearer_stop")
            self.rig.run_ms(3)
        self.rig.ask(ArmBoard)

    def disarm(self) -> None:
        self.rig.ask(DisarmBoard, lease=LEASE)

    def measure(self) -> None:
        self.rig.ask(MeasureContact, lease=LEASE)

    def stop(self) -> None:
        self.rig.ask(StopNow, client="somebody")

    def clear(self) -> None:
        self.rig.ask(ClearHalt)

    def wait(self, duration_ms: int) -> None:
        self.rig.run_ms(duration_ms)

    def stall(self, duration_ms: int) -> None:
        """The whole engine gets no processor for so long."""
        self.rig.clock.spend(duration_ms * 1_000_000)

    def lift(self, electrode: int) -> None:
        self.rig.fake.world.lift(electrode)
        self._look([electrode])

    def touch(self, electrode: int) -> None:
        self.rig.fake.world.touch(electrode, skin())
        self._look([electrode])

    def _look(self, electrodes: Iterable[int]) -> None:
        body = self.rig.fake.world.body
        for electrode in electrodes:
            self.story.contacts.append(
                (self.now_ns, electrode, body.contact(electrode).conductance_s)
            )

    def press(self, line: StopName) -> None:
        if getattr(self.rig.engine.components.loaded.board.guards, line) != "absent":
            self.story.presses.append(self.now_ns)
            self.rig.fake.world.press(line)

    def release(self, line: StopName) -> None:
        if getattr(self.rig.engine.components.loaded.board.guards, line) != "absent":
            self.rig.fake.world.release(line)

    def disturb_rail(self, factor: float, duration_ms: int) -> None:
        fault = RailOff(factor)
        self.rig.fake.world.put_in(fault)
        self.rig.run_ms(duration_ms)
        self.rig.fake.world.take_out(fault)

    def new_person(self, caps_ua: Sequence[int]) -> None:
        """Whatever was, somebody else is armed now, unless the world will not have it."""
        self.release("emergency_stop")
        self.release("wearer_stop")
        self.close()
        self.clear()
        # Also one with the caps of the one before.
        self._person += 1
        self.open(caps_ua)
        self.arm()

    def frame(self, fields: dict[str, Any], is_streamed: bool, repeats: int, pause_ms: int) -> None:
        """The same frame some times, with a pause after each."""
        for _ in range(repeats):
            self.one_frame(is_streamed, **fields)
            self.wait(pause_ms)

    def one_frame(self, is_streamed: bool = False, **fields: Any) -> None:
        """A frame, whether it is accepted or not."""
        sent_ns = self.now_ns
        seq = self.rig.last_seq + 1
        frame = Frame(lease=LEASE, seq=seq, sent_ns=sent_ns, **fields)
        if is_streamed:
            self._stream(frame)
            # By its own number: the frame before it may be told as never shown just now.
            refusals = [
                report.refused.seq for report in self.rig.reports if report.refused is not None
            ]
            error = seq in refusals
        else:
            answer = self.rig.show(sent_ns=sent_ns, **fields)
            error = answer.error is not None
            assert bool(answer.reason) == error, "a refusal has a reason"
        if error:
            self.story.refused.add(seq)
        else:
            self.story.frames[seq] = self._sent(frame, sent_ns)

    def _stream(self, frame: Frame) -> None:
        self.rig.send(sent_ns=frame.sent_ns, **_given(frame))
        self.rig.step()
        self.rig.step()

    def _sent(self, frame: Frame, sent_ns: int) -> SentFrame:
        assert self._calibration is not None
        current_ua = frame.current_ua
        if current_ua is None:
            assert frame.level is not None
            current_ua = currents_of_levels(self._calibration, frame.level)
        width_us = frame.width_us if isinstance(frame.width_us, int) else _LEVEL_WIDTH_US
        return SentFrame(
            frame.seq,
            current_ua,
            width_us,
            sent_ns,
            frame.ttl_ms,
            self._returns(frame.returns),
            frame.pulses,
        )

    def _returns(self, returns: Returns | None) -> tuple[tuple[int, ...], ...] | None:
        array = self.rig.engine.components.loaded.array
        if isinstance(returns, Ring):
            return tuple(array.ring(electrode, returns.ring_mm) for electrode in range(array.count))
        return returns if isinstance(returns, tuple) else None

    def end(self) -> list[dict[str, Any]]:
        """Let everything be told, and the engine end; the trace."""
        self.close()
        self.rig.run_ms(60)
        problems = self.rig.close()
        assert problems == ()
        self.story.reports = self.rig.reports
        self.story.requests = self._adapter.asked
        return self.rig.trace()


def _given(frame: Frame) -> dict[str, Any]:
    fields = msgspec.structs.asdict(frame)
    for key in ("lease", "seq", "sent_ns"):
        del fields[key]
    return {key: value for key, value in fields.items() if value is not None}
