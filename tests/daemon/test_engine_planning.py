"""Frames whose plans take long: everything else is looked at meanwhile, and the pulses go on."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import SupportsIndex, overload

import msgspec
import pytest

from engine_rig import LEASE, EngineRig, turn
from engine_scenes import (
    MS,
    fully_open,
    halts,
    longest_gap_ns,
    only,
    phases,
    shown,
)
from etd.protocol.frame import Frame
from etd.protocol.link import Channel, CloseLease, DisarmBoard, NewFrame, OpenLease
from etd.protocol.messages import Limits
from etd_hal.fake.clock import SteppedClock

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 64
REFERENCE = "reference-hv507"
WINDOW_NS = 20 * MS
ALL = (500,) * N
LIMITS = Limits(max_current_ua=3_000, width_us=200)


class Costly(tuple[int, ...]):
    """Values that take their time to be looked at, one by one: in stepped time nothing else tells
    how long a plan is thought about.
    """

    clock: SteppedClock
    each_ns: int

    @overload
    def __getitem__(self, index: SupportsIndex) -> int: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[int, ...]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> int | tuple[int, ...]:
        self.clock.spend(self.each_ns)
        return super().__getitem__(index)

    def __iter__(self) -> Iterator[int]:
        for electrode in super().__iter__():
            self.clock.spend(self.each_ns)
            yield electrode


class SlowPlans(Channel[NewFrame]):
    """The engine's end of frames that each take so long to plan."""

    def __init__(self, end: socket.socket, clock: SteppedClock, plan_ns: int) -> None:
        super().__init__(end, NewFrame)
        self._clock = clock
        self.plan_ns = plan_ns
        self.taken = 0

    def receive(self) -> NewFrame | None:
        message = super().receive()
        if message is None:
            return None
        self.taken += 1
        values = Costly(message.frame.current_ua or ())
        values.clock, values.each_ns = self._clock, self.plan_ns // len(values)
        frame = msgspec.structs.replace(message.frame, current_ua=values)
        return msgspec.structs.replace(message, frame=frame)


def slow(rig: EngineRig, plan_ms: float) -> SlowPlans:
    """With a gateway whose frames take so long to plan, from the next call on."""
    made: list[SlowPlans] = []

    def frames_of(end: socket.socket) -> Channel[NewFrame]:
        made.append(SlowPlans(end, rig.clock, 0))
        return made[0]

    rig.commands.close()
    while rig.engine.has_gateway:
        turn(rig.engine)
    rig.attach_next_gateway(frames_of)
    fully_open(rig, 600)
    made[0].plan_ns = int(plan_ms * MS)
    return made[0]


def send(rig: EngineRig, seq: int, ref: int, **fields: object) -> None:
    frame = Frame(**{"lease": LEASE, "seq": seq, "current_ua": ALL, "ttl_ms": 1_000, **fields})  # type: ignore[arg-type]
    assert rig.frames.send(NewFrame(ref=ref, frame=frame))


#: More than a plan for 256 electrodes takes on the slowest machine, and three times that.
PLAN_MS = [11, 35]


@pytest.mark.parametrize("plan_ms", PLAN_MS)
def test_the_heart_beats_while_many_frames_are_planned(make_rig: MakeRig, plan_ms: int) -> None:
    rig = make_rig(REFERENCE)
    slow(rig, plan_ms)
    since_ns = rig.clock.now_ns()
    for number in range(32):
        send(rig, 1_000 + number, 5_000 + number, rate_hz=20.0)
    answered: dict[int, str | None] = {}
    while len(answered) < 32:
        rig.step()
        answered |= {ref: answer.error for ref, answer in rig.answers.items() if ref >= 5_000}
    assert longest_gap_ns(rig, since_ns, rig.clock.now_ns()) <= WINDOW_NS
    assert answered.keys() == set(range(5_000, 5_032))
    assert {*answered.values()} <= {None, "expired"}
    planned = list(answered.values()).count(None)
    assert rig.clock.now_ns() - since_ns >= planned * plan_ms * MS


def test_the_heart_beats_while_frames_are_planned_within_a_scan(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    frames = slow(rig, 0)
    rig.show(current_ua=ALL, rate_hz=5.0, ttl_ms=1_000)
    frames.plan_ns = 55 * MS
    since_ns = rig.clock.now_ns()
    for number in range(32):
        rig.clock.at(
            since_ns + 25 * number * MS,
            lambda seq=1_000 + number: send(rig, seq, 0, rate_hz=5.0),  # type: ignore[misc]
        )
    rig.run_ms(800)
    assert frames.taken > 20
    assert longest_gap_ns(rig, since_ns, rig.clock.now_ns()) <= WINDOW_NS
    assert rig.state == "ARMED"


@pytest.mark.parametrize("plan_ms", PLAN_MS)
def test_a_stop_line_is_heard_while_frames_are_planned(make_rig: MakeRig, plan_ms: int) -> None:
    rig = make_rig(REFERENCE)
    slow(rig, plan_ms)
    pressed_ns = rig.clock.now_ns() + 30 * MS
    rig.clock.at(pressed_ns, lambda: rig.fake.world.press("emergency_stop"))
    for number in range(32):
        send(rig, 1_000 + number, 5_000 + number, rate_hz=20.0)
    while rig.state != "HALTED":
        rig.step()
    assert halts(rig)[0].source == "emergency_stop"
    assert halts(rig)[0].t_ns < pressed_ns + 5 * MS
    rig.run_ms(200)
    assert {answer.error for ref, answer in rig.answers.items() if ref >= 5_010} == {"halted"}
    # Among them the frame that was being planned.
    assert {answer.error for answer in rig.answers.values()} <= {None, "halted"}


def test_pulses_go_on_between_frames_that_take_long_to_plan(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    frames = slow(rig, 0)
    rig.show(current_ua=only(N, e3=500), rate_hz=60.0, ttl_ms=1_000)
    frames.plan_ns = 11 * MS
    rig.run_ms(20)
    since_ns = rig.clock.now_ns()
    for number in range(32):
        send(rig, 1_000 + number, 5_000 + number, current_ua=only(N, e3=500), rate_hz=60.0)
    rig.run_ms(360)
    begun_ns = [phase.from_ns for phase in phases(rig, since_ns) if phase.electrode == 3]
    gaps_ns = [after - before for before, after in pairwise(begun_ns)]
    # A period, a plan that has just begun, and the pause of a processor that was busy.
    assert max(gaps_ns) < 50 * MS


# --- what a look may change while a frame is planned ----------------------------------------------


def test_a_frame_whose_lease_is_closed_while_it_is_planned_is_not_shown(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    slow(rig, 55)
    rig.run_ms(250)
    since_ns = rig.clock.now_ns()
    rig.clock.at(since_ns + 20 * MS, lambda: rig.commands.send(CloseLease(ref=0, lease=LEASE)))
    send(rig, 1_000, 5_000, rate_hz=20.0)
    assert rig.wait_for(5_000).error == "no_lease"
    assert rig.state == "SAFE"
    rig.run_ms(100)
    assert phases(rig, since_ns) == []


def test_a_frame_is_not_shown_in_the_next_lease_of_the_same_name(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    slow(rig, 55)

    def change() -> None:
        rig.commands.send(CloseLease(ref=0, lease=LEASE))
        rig.commands.send(OpenLease(ref=0, lease=LEASE, client="next", limits=LIMITS))

    rig.clock.at(rig.clock.now_ns() + 20 * MS, change)
    send(rig, 1_000, 5_000, rate_hz=20.0)
    assert rig.wait_for(5_000).error == "no_lease"
    assert rig.engine.supervisor.lease is not None
    assert rig.engine.supervisor.lease.last_seq == -1


def test_a_frame_is_refused_when_the_board_is_disarmed_while_it_is_planned(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(REFERENCE)
    slow(rig, 55)
    rig.clock.at(
        rig.clock.now_ns() + 20 * MS, lambda: rig.commands.send(DisarmBoard(ref=0, lease=LEASE))
    )
    send(rig, 1_000, 5_000, rate_hz=20.0)
    assert rig.wait_for(5_000).error == "not_armed"
    assert [frame.seq for frame in shown(rig)][-1] != 1_000
