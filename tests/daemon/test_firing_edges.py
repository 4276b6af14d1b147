"""Firing at its edges: what is connected, what drifts, and what is left where something fails."""

from __future__ import annotations

import pytest

from etd.firing import ReadyPulse, prepulse_of
from etd.protocol.errors import BoardFault, BusError
from etd.pulse.request import PulseRequest
from etd_hal.fake.faults import MisoFlipped, SlowWords, SpiError, SpiShort, SpiStall
from etd_hal.switch_shadow import Prepulse
from firing_scene import CURRENT_UA, HERE, KAJIMOTO, PHASE_PC, RELAY, WIDTH_US, Scene


def again(scene: Scene) -> None:
    """The same pulse, when it may come again."""
    scene.rig.clock.sleep_until_ns(scene.ledger.rested_ns(HERE))
    booking = scene.firing.connect(scene.ready)
    scene.firing.fire(booking, scene.ready)


@pytest.mark.parametrize("phases", [(True,), (False,), (True, False)])
def test_connecting_books_the_worst_and_connects_the_way_of_the_first_phase(
    phases: tuple[bool, ...],
) -> None:
    scene = Scene(phases=phases)
    scene.rig.board.discharge()
    scene.rig.board.prepare(scene.ready.selection, whole=True)
    assert not scene.is_connected
    booking = scene.firing.connect(scene.ready)
    assert scene.is_connected
    assert scene.booked_pc == booking.charge_pc > PHASE_PC * len(phases)
    before_pc = scene.body.charge_pc(HERE)
    scene.firing.fire(booking, scene.ready)
    if len(phases) == 1:
        way = 1 if phases[0] else -1
        assert way * (scene.body.charge_pc(HERE) - before_pc) > 0


def test_what_could_not_be_connected_is_taken_back_and_told() -> None:
    """The node is looked at before relays close."""
    scene = Scene(RELAY)
    scene.rig.board.discharge()
    scene.rig.board.prepare(scene.ready.selection, whole=True)
    scene.rig.fake.world.put_in(SpiError(1))
    with pytest.raises(BusError):
        scene.firing.connect(scene.ready)
    assert scene.booked_pc == 0
    assert scene.left_pc == 0


def test_a_reading_that_cannot_be_makes_the_board_safe_and_is_told_as_it_is() -> None:
    """One word of it, so that the board becomes safe after it."""
    scene = Scene()
    with pytest.raises(BoardFault) as raised:
        scene.fire(MisoFlipped(0))
    assert "failed;" not in str(raised.value)
    assert not scene.is_connected
    assert scene.left_pc > PHASE_PC


def test_a_pulse_that_takes_less_than_its_plan_is_booked_as_planned() -> None:
    scene = Scene(phases=(True, False))
    live, ready = scene.rig.board, scene.ready
    live.discharge()
    scene.rig.fake.world.put_in(SlowWords(2))
    live.calibrate()
    scene.rig.fake.world.mend()
    pulse = live.pulse(CURRENT_UA, WIDTH_US)
    scene.ready = ReadyPulse(ready.entry, ready.selection, ready.phases, pulse, ready.given)
    booking = scene.firing.connect(scene.ready)
    first, last = scene.firing.fire(booking, scene.ready)
    assert max(first.excess_ns, last.excess_ns) < 0
    assert scene.booked_pc == 2 * PHASE_PC
    assert scene.left_pc == 0


def test_messages_that_are_late_again_and_again_are_a_drift_until_it_is_reset() -> None:
    """A mean of messages, by a fiftieth each: a few of 30 us are more than 1.5."""
    scene = Scene()
    again(scene)
    assert not scene.firing.has_drifted
    for _ in range(2):
        scene.rig.fake.world.put_in(SpiStall(30))
        again(scene)
    assert not scene.firing.has_drifted, "1.2 us in the mean"
    scene.rig.fake.world.put_in(SpiStall(30))
    again(scene)
    assert scene.firing.has_drifted, "1.8 us in the mean"
    scene.firing.reset_drift()
    assert not scene.firing.has_drifted
    for _ in range(20):
        again(scene)
    assert not scene.firing.has_drifted


def test_a_drift_wears_off_with_messages_that_are_on_time() -> None:
    scene = Scene()
    for _ in range(3):
        scene.rig.fake.world.put_in(SpiStall(30))
        again(scene)
    assert scene.firing.has_drifted
    for _ in range(20):
        again(scene)
    assert not scene.firing.has_drifted


@pytest.mark.parametrize("stall_us", [300, 301])
def test_a_check_of_outputs_that_select_nothing_returns_what_was_read_or_is_a_fault(
    stall_us: int,
) -> None:
    scene = Scene(KAJIMOTO)
    live = scene.rig.board
    live.discharge()
    live.isolate()
    given = PulseRequest(300, WIDTH_US // 2)
    for fire in (scene.firing.fire_unloaded, scene.firing.fire_unselected):
        scene.rig.fake.world.put_in(SpiStall(stall_us))
        pulse = live.pulse(given.current_ua, given.width_us)
        if stall_us > 300:
            with pytest.raises(BoardFault, match="with nothing connected"):
                fire(pulse, given)
        else:
            assert fire(pulse, given).excess_ns == stall_us * 1_000


def test_a_short_message_of_a_first_phase_counts_to_the_last_nanosecond() -> None:
    scene = Scene()
    with pytest.raises(BusError):
        scene.fire(SpiShort())
    booked_pc = scene.booked_pc
    assert booked_pc == int(booked_pc)
    assert isinstance(booked_pc, int)
    assert scene.left_pc <= booked_pc


def test_a_prepulse_is_told_to_the_guard_where_there_is_one() -> None:
    assert prepulse_of(PulseRequest(1_000, 100)) is None
    led = PulseRequest(1_000, 100, prepulse_ua=300, prepulse_us=40)
    assert prepulse_of(led) == Prepulse(300, 40)
