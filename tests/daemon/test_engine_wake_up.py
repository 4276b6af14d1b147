"""A frame or a command that comes between two polls is heeded when it comes, not a tick later."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest

from engine_rig import LEASE, EngineRig, turn
from engine_scenes import MS, armed, fully_open, halts, longest_gap_ns, only, phases
from etd.protocol.frame import Frame
from etd.protocol.link import Alive, NewFrame, StopNow
from etd_hal.fake.processor import StagedTime

MakeRig = Callable[..., EngineRig]
US = 1_000
N = 64
WINDOW_NS = 20 * MS
#: No sensor is read in between, which takes half a millisecond in stepped time.
PLAIN = "kajimoto-hv507"
#: What the first pulse's calls take, by which the chain is shifted as far as the electrode.
FIRST_PULSE_NS = 150 * US
#: The whole chain is rewritten for it.
MADE_SAFE_NS = 650 * US


def frame(seq: int, **fields: object) -> NewFrame:
    asked = {"current_ua": only(N, e3=500), "rate_hz": 20.0, "pulses": 1, **fields}
    return NewFrame(ref=0, frame=Frame(lease=LEASE, seq=seq, **asked))  # type: ignore[arg-type]


@pytest.mark.parametrize("after_us", [10, 400, 990])
def test_a_frame_to_a_silent_display_is_begun_when_it_comes(
    make_rig: MakeRig, after_us: int
) -> None:
    rig = fully_open(make_rig(PLAIN), 500)
    rig.run_ms(220)
    rig.step()
    came_ns = rig.clock.now_ns() + after_us * US
    rig.clock.at(came_ns, lambda: rig.frames.send(frame(1_000)))
    rig.run_ms(5)
    (pulse,) = phases(rig, came_ns)
    assert pulse.electrode == 3
    assert came_ns < pulse.from_ns < came_ns + FIRST_PULSE_NS


def test_a_stop_from_the_gateway_is_heeded_when_it_comes(make_rig: MakeRig) -> None:
    rig = armed(make_rig(PLAIN))
    turn(rig.engine)
    came_ns = rig.clock.now_ns() + 300 * US
    rig.clock.at(came_ns, lambda: rig.commands.send(StopNow(ref=0, client="operator")))
    for _ in range(2):
        turn(rig.engine)
    rig.listen()
    assert came_ns < halts(rig)[0].t_ns < came_ns + MADE_SAFE_NS


def test_a_frame_just_before_a_scan_is_planned_before_it_begins(make_rig: MakeRig) -> None:
    """On a machine on which its plan takes 0.2 ms, by which the scan would be late."""
    rig = fully_open(make_rig(PLAIN, processor=StagedTime(4.0)), 500)
    rig.show(current_ua=only(N, e3=400), rate_hz=20.0, ttl_ms=1_000)
    rig.run_ms(120)
    due_ns = phases(rig)[-1].from_ns + 50 * MS
    rig.clock.at(due_ns - 500 * US, lambda: rig.frames.send(frame(1_000, pulses=None)))
    rig.run_ms(70)
    first = next(phase for phase in phases(rig, due_ns - MS) if phase.electrode == 3)
    assert first.current_ua > 480
    assert abs(first.from_ns - due_ns) < 120 * US


def test_the_heart_beats_and_scans_are_on_time_while_messages_come_without_end(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig("reference-hv507"), 500)
    since_ns, end_ns = rig.clock.now_ns(), rig.clock.now_ns() + 400 * MS
    seqs = iter(range(1_000, 1_000_000))

    def again() -> None:
        rig.commands.send(Alive())
        rig.frames.send(frame(next(seqs), pulses=None))
        if rig.clock.now_ns() < end_ns:
            rig.clock.at(rig.clock.now_ns() + 30 * US, again)

    again()
    rig.run_ms(400)
    assert longest_gap_ns(rig, since_ns, end_ns) <= WINDOW_NS // 2
    begun_ns = [phase.from_ns for phase in phases(rig, since_ns)]
    gaps_ns = [after - before for before, after in pairwise(begun_ns)]
    assert len(begun_ns) == 8
    # A poll that reads what has come may be under way when a scan is due.
    assert max(gaps_ns) - min(gaps_ns) < 600 * US
    assert rig.state == "ARMED"


@pytest.mark.parametrize(("is_armed", "polls"), [(False, 20), (True, 100)])
def test_without_supply_it_polls_less_often(make_rig: MakeRig, is_armed: bool, polls: int) -> None:
    rig = make_rig(PLAIN)
    rig.open()
    if is_armed:
        rig.arm()
    rig.is_gateway_alive = False
    rig.run_ms(50)
    dozes = rig.engine.components.clock.dozes
    rig.run_ms(100)
    assert rig.engine.components.clock.dozes - dozes == pytest.approx(polls, abs=2)
