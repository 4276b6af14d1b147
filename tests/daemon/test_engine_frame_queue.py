"""What lies in the queue of frames: how much of it one look takes, and what becomes of the rest."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable

import msgspec
import pytest

from engine_rig import LEASE, EngineRig, turn
from engine_scenes import MS, armed, fully_open, longest_gap_ns, only, phases, shown
from etd.protocol.frame import Frame
from etd.protocol.link import MAX_DATAGRAM_BYTES, Alive, Channel, NewFrame, StopNow

MakeRig = Callable[..., EngineRig]
N = 16


def frame(seq: int, electrode: int = 3, ref: int = 0, ttl_ms: int = 500) -> NewFrame:
    wanted_ua = only(N, **{f"e{electrode}": 500})
    made = Frame(lease=LEASE, seq=seq, current_ua=wanted_ua, ttl_ms=ttl_ms)
    return NewFrame(ref=ref, frame=made)


class Refilled(socket.socket):
    """An engine's end: for each datagram that is read a new one comes, so many times."""

    def __init__(self, end: socket.socket, times: int, make: Callable[[int], bytes]) -> None:
        super().__init__(fileno=end.detach())
        self._times = times
        self._make = make
        self.are_read = 0
        self.gateway: socket.socket | None = None
        #: Called at each datagram that is read, for what the world does meanwhile.
        self.meanwhile: Callable[[], None] = lambda: None

    def recv(self, bufsize: int, flags: int = 0, /) -> bytes:
        data = super().recv(bufsize, flags)
        self.are_read += 1
        self.meanwhile()
        if self.gateway is not None and self.are_read <= self._times:
            self.gateway.send(self._make(self.are_read))
        return data


def flooded(
    rig: EngineRig, times: int, make: Callable[[int], bytes]
) -> tuple[Refilled, socket.socket]:
    """A new gateway, whose socket for frames is full of new ones as long as one is read."""
    made: list[Refilled] = []

    def frames_of(end: socket.socket) -> Channel[NewFrame]:
        made.append(Refilled(end, times, make))
        return Channel(made[0], NewFrame)

    rig.commands.close()
    while rig.engine.has_gateway:
        turn(rig.engine)
    rig.attach_next_gateway(frames_of)
    gateway = socket.socket(fileno=os.dup(rig.frames.fileno()))
    made[0].gateway = gateway
    return made[0], gateway


def small(seq: int) -> bytes:
    return msgspec.msgpack.encode(frame(seq))


def large(seq: int) -> bytes:
    """Nearly as large as a datagram may be: its lease is none."""
    padded = msgspec.structs.replace(frame(seq).frame, lease="x" * (MAX_DATAGRAM_BYTES - 1_000))
    return msgspec.msgpack.encode(NewFrame(ref=0, frame=padded))


@pytest.mark.parametrize(("make", "most"), [(small, 1_024), (large, 16)], ids=["many", "large"])
def test_a_gateway_that_sends_as_fast_as_it_is_read_does_not_keep_the_engine_reading(
    make_rig: MakeRig, make: Callable[[int], bytes], most: int
) -> None:
    rig = make_rig(electrodes=N)
    flooding, gateway = flooded(rig, 20 * most, make)
    gateway.send(make(0))
    for turns in range(1, 4):
        turn(rig.engine)
        assert 0 < flooding.are_read <= turns * most
    gateway.close()


def test_a_stop_is_heard_in_the_midst_of_a_flood_of_frames(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    flooding, gateway = flooded(rig, 900, small)
    armed(rig)
    heard_after: list[int] = []

    def meanwhile() -> None:
        if flooding.are_read == 200:
            rig.commands.send(StopNow(ref=0, client="operator"))
        if rig.state == "HALTED":
            heard_after.append(flooding.are_read)

    flooding.meanwhile = meanwhile
    gateway.send(small(0))
    turn(rig.engine)
    assert heard_after
    assert heard_after[0] <= 200 + 64 + 1
    gateway.close()


def test_the_heart_beats_through_a_flood_of_frames(make_rig: MakeRig) -> None:
    """Where reading and decoding one takes 100 us, as on a slow machine."""
    rig = make_rig("reference-hv507")
    flooding, gateway = flooded(rig, 2_000, small)
    armed(rig)
    flooding.meanwhile = lambda: rig.clock.spend(100_000)
    since_ns = rig.clock.now_ns()
    gateway.send(small(0))
    rig.run_ms(250)
    assert flooding.are_read > 2_000
    assert longest_gap_ns(rig, since_ns, rig.clock.now_ns()) <= 20 * MS
    gateway.close()


def test_of_many_streamed_frames_a_few_are_planned_and_the_newest_stands(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(electrodes=N), 600)
    rig.reports.clear()
    before = rig.engine.components.reporter.counters["frames_superseded"]
    for seq in range(1_000, 1_300):
        assert rig.frames.send(frame(seq, electrode=seq % N))
    rig.run_ms(60)
    superseded = rig.engine.components.reporter.counters["frames_superseded"] - before
    assert superseded >= 290
    seqs = [frame.seq for frame in shown(rig)]
    assert seqs == sorted(seqs)
    assert seqs[-1] == 1_299
    since_ns = rig.clock.now_ns()
    rig.run_ms(60)
    assert {phase.electrode for phase in phases(rig, since_ns)} == {1_299 % N}


def test_every_frame_that_wants_an_answer_gets_one_in_order(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 600)
    refs = []
    for seq in range(1_000, 1_200):
        ref = 10_000 + seq if seq % 5 == 0 else 0
        refs += [ref] if ref else []
        assert rig.frames.send(frame(seq, ref=ref))
    answered: list[int] = []
    while len(answered) < len(refs):
        rig.step()
        answered += rig.answers
        assert [answer.error for answer in rig.answers.values()] == [None] * len(rig.answers)
        rig.answers.clear()
    assert answered == refs
    rig.run_ms(60)
    assert shown(rig)[-1].seq == 1_199


def test_what_one_look_leaves_after_a_stall_is_as_old_as_the_stall(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 600)
    rig.run_ms(250)
    for seq in range(1_000, 1_200):
        assert rig.frames.send(frame(seq, ttl_ms=200))
    for _ in range(8):
        rig.commands.send(Alive())
        rig.stand_still_ms(50)
    rig.commands.send(Alive())
    since_ns = rig.clock.now_ns()
    rig.run_ms(60)
    assert phases(rig, since_ns) == []
    assert rig.state == "ARMED"


def test_what_is_read_last_of_many_is_as_old_as_the_first_read(make_rig: MakeRig) -> None:
    """On a machine that takes half a millisecond for each: no poll is late, but the last frame has
    waited for 300 ms, and its ttl is 200 ms.
    """
    rig = make_rig(electrodes=N)
    reading, gateway = flooded(rig, 0, small)
    fully_open(rig, 600)
    rig.run_ms(250)

    def meanwhile() -> None:
        rig.commands.send(Alive())
        rig.clock.spend(MS // 2)

    reading.meanwhile = meanwhile
    for seq in range(1_000, 1_600):
        assert rig.frames.send(frame(seq, ttl_ms=200))
    since_ns = rig.clock.now_ns()
    rig.run_ms(400)
    assert phases(rig, since_ns) == []
    assert rig.state == "ARMED"
    rig.frames.send(frame(1_600, ttl_ms=200))
    rig.run_ms(50)
    assert phases(rig, since_ns) != []
    gateway.close()
