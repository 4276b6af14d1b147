"""The stopper under the engine: what it cut is a halt, and it must be seen to look."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import (
    MS,
    armed,
    config,
    dac_codes,
    ended_leases,
    fully_open,
    halts,
    moves,
    only,
    phases,
)
from etd.engine.stopper import SILENT_NS
from etd.protocol.link import ArmBoard, ClearHalt, CloseLease, DisarmBoard, KeepLease
from etd_hal.fake.faults import DacGain, SpiStall

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
REFERENCE, KIT, RELAYS = "reference-hv507", "kajimoto-hv507", "feetthrough-relay"
BOARDS = [REFERENCE, KIT, RELAYS]
SILENT_MS = SILENT_NS // MS


def forgiving(board: str) -> EngineRig:
    """Open, on a machine where a late message alone is no fault: what halts then is the cut."""
    machine: dict[str, Any] = {"halt_excess_us": 5e6, "drift_us": 5e6}
    electrodes = 32 if board == RELAYS else 16
    rig = fully_open(engine_rig.make(loaded=config(board, electrodes, machine=machine)), 400)
    rig.run_ms(300)
    return rig


def stall(rig: EngineRig, stall_ms: int, polarity: str = "anodic") -> None:
    """A frame of two pulses; the message of the first stands still for so long."""
    # On relay boards a look at the node goes before each pulse.
    is_relays = rig.engine.components.board.switch.can_choose_returns
    rig.fake.world.put_in(SpiStall(stall_ms * 1_000, at_message=2 if is_relays else 1))
    count = rig.engine.components.loaded.array.count
    rig.send(
        current_ua=only(count, e1=400, e2=400),
        width_us=50,
        polarity=polarity,
        pulses=1,
        rate_hz=10.0,
        ttl_ms=1_000,
    )


def assert_works_again(rig: EngineRig) -> None:
    """And nothing was done that must never be done."""
    assert rig.ask(ClearHalt).error is None
    rig.open()
    rig.arm()
    assert rig.state == "ARMED"
    assert rig.close() == ()


# --- what it cut ----------------------------------------------------------------------------------


@pytest.mark.parametrize("polarity", ["anodic", "cathodic", "biphasic", "biphasic_cathodic_first"])
@pytest.mark.parametrize("board", BOARDS)
def test_what_the_stopper_cut_is_a_halt(board: str, polarity: str) -> None:
    """Whatever the machine lets a message take: the first one stalls, no other follows."""
    rig = forgiving(board)
    since_ns = rig.clock.now_ns()
    stall(rig, 20, polarity)
    rig.run_ms(100)
    assert rig.state == "HALTED"
    (halt,) = halts(rig)
    assert halt.cause == "fault"
    assert "cut off" in halt.detail
    words = [code for _, code in dac_codes(rig, since_ns)]
    assert len([after for before, after in pairwise([0, *words]) if after and not before]) == 1
    assert_works_again(rig)


@pytest.mark.parametrize("board", BOARDS)
def test_a_lease_that_lapses_in_the_same_look_hides_no_cut(board: str) -> None:
    """Nor does a gateway that has been silent as long: SAFE would hold the cut for ever."""
    rig = forgiving(board)
    stall(rig, 1_200)
    rig.run_ms(1_300)
    assert rig.state == "HALTED"
    (halt,) = halts(rig)
    assert "cut off" in halt.detail
    assert [ended_lease.reason for ended_lease in ended_leases(rig)] == ["halted"]
    assert rig.ask(ArmBoard).error == "halted"
    assert_works_again(rig)


@pytest.mark.parametrize("way", [DisarmBoard, CloseLease])
def test_a_command_in_the_same_look_hides_no_cut(way: type[DisarmBoard | CloseLease]) -> None:
    rig = forgiving(RELAYS)
    stall(rig, 20)
    rig.clock.at(rig.clock.now_ns() + 10 * MS, lambda: rig.commands.send(way(ref=0, lease=LEASE)))
    rig.run_ms(100)
    assert rig.state == "HALTED"
    assert halts(rig)[0].source == "stopper"
    assert_works_again(rig)


@pytest.mark.parametrize("board", BOARDS)
def test_a_cut_is_a_halt_also_where_the_board_is_safe_again_before_the_next_poll(
    board: str,
) -> None:
    """The check of the source stalls and tells a wrong gain, which ends the arming in SAFE. A cut
    that were not seen there would keep the stopper from cutting ever again.
    """
    machine: dict[str, Any] = {"halt_excess_us": 5e6, "drift_us": 5e6}
    rig = engine_rig.make(loaded=config(board, machine=machine))
    rig.open()
    if rig.engine.components.loaded.board.guards.wearer_stop != "absent":
        rig.try_wearer_stop()
    for fault in (DacGain(1.5), SpiStall(20_000)):
        rig.fake.world.put_in(fault)
    assert "with nothing connected" in rig.ask(ArmBoard).reason
    rig.run_ms(5)
    assert rig.state == "HALTED"
    (halt,) = halts(rig)
    assert halt.source == "stopper"
    assert "cut off" in halt.detail
    rig.fake.world.mend()
    assert rig.ask(ClearHalt).error is None
    assert not rig.engine.components.stopper_liveness.has_acted
    assert rig.close() == ()


# --- whether it looks -----------------------------------------------------------------------------


@pytest.mark.parametrize("board", BOARDS)
def test_a_stopper_that_does_not_look_refuses_arming_before_the_supply_is_on(
    make_rig: MakeRig, board: str
) -> None:
    rig = make_rig(board)
    rig.stopper.is_looking = False
    rig.open()
    if board == REFERENCE:
        rig.try_wearer_stop()
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert answer.reason.startswith("the stopper made no check for 50")
    assert "it has ended or hangs: restart the daemon" in answer.reason
    assert rig.state == "SAFE"
    assert phases(rig) == []
    if board != KIT:
        assert 1 not in {level for _, level in moves(rig, "HV")}
    assert halts(rig) == []


def test_a_stopper_that_comes_late_is_waited_for(make_rig: MakeRig) -> None:
    """For as long behind any time for which it slept, the supply being off."""
    rig = make_rig()
    rig.run_ms(2 * SILENT_MS)
    rig.stopper.is_looking = False
    rig.open()
    ref = rig.next_ref()
    rig.commands.send(ArmBoard(ref=ref))
    rig.run_ms(SILENT_MS - 50)
    assert rig.state == "PROBE"
    assert phases(rig) == []
    rig.stopper.is_looking = True
    assert rig.wait_for(ref).error is None
    assert rig.state == "ARMED"


def test_what_it_looked_at_before_it_was_woken_is_no_sign_of_life(make_rig: MakeRig) -> None:
    rig = armed(make_rig())
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    rig.stopper.is_looking = False
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "made no check" in answer.reason


@pytest.mark.parametrize("board", BOARDS)
def test_a_stopper_that_looks_no_more_halts_an_armed_board(make_rig: MakeRig, board: str) -> None:
    """While a frame is shown, and with the lease held."""
    rig = fully_open(make_rig(board), 400)

    def keep(_: int) -> None:
        rig.commands.send(KeepLease(ref=0, lease=LEASE))

    rig.meanwhile = keep
    rig.stopper.is_looking = False
    silent_from_ns = rig.clock.now_ns()
    count = rig.engine.components.loaded.array.count
    while rig.state == "ARMED":
        rig.send(current_ua=only(count, e1=400, e2=400), width_us=50, rate_hz=20.0)
        rig.run_ms(50)
        assert rig.clock.now_ns() < silent_from_ns + 1_000 * MS
    assert rig.state == "HALTED"
    (halt,) = halts(rig)
    assert (halt.cause, halt.source) == ("fault", "stopper")
    assert "the stopper made no check for 50" in halt.detail
    assert SILENT_NS - MS <= halt.t_ns - silent_from_ns <= SILENT_NS + 60 * MS
    # It is dead still: clear leads out of HALTED, and arming says why it does not go on.
    assert rig.ask(ClearHalt).error is None
    rig.open()
    if rig.engine.components.loaded.board.guards.wearer_stop != "absent":
        rig.try_wearer_stop()
    assert "made no check" in rig.ask(ArmBoard).reason
    rig.stopper.is_looking = True
    rig.arm()
    assert rig.state == "ARMED"


def test_a_stopper_that_looks_no_more_halts_a_board_on_its_way_up(make_rig: MakeRig) -> None:
    """Its relay board's supply settles for half a second."""
    rig = make_rig(RELAYS)
    rig.open()
    ref = rig.next_ref()
    rig.commands.send(ArmBoard(ref=ref))
    rig.run_ms(10)
    assert rig.engine.components.board.is_supply_on
    rig.stopper.is_looking = False
    answer = rig.wait_for(ref)
    assert answer.error == "arm_failed"
    assert "made no check" in answer.reason
    assert rig.state == "HALTED"
    assert halts(rig)[0].source == "stopper"
    assert moves(rig, "HV")[-1][1] == 0


def test_one_that_looks_seldom_is_no_fault(make_rig: MakeRig) -> None:
    """As on a machine that is busy: ten times slower than this it would be one."""
    rig = make_rig()
    rig.stopper.period_ns = SILENT_NS // 2
    armed(rig)
    rig.hold(2_000, current_ua=only(64, e1=400, e2=400), width_us=50)
    assert rig.state == "ARMED"


@pytest.mark.parametrize("board", [KIT, RELAYS])
def test_a_process_that_was_stopped_finds_no_fault_in_its_stopper(
    make_rig: MakeRig, board: str
) -> None:
    """Five seconds in which neither thread had the processor; the scan thread has it first."""
    rig = armed(make_rig(board))
    rig.stopper.is_looking = False
    rig.clock.spend(5_000 * MS)
    for _ in range(10):
        rig.step()
    rig.stopper.is_looking = True
    rig.run_ms(600)
    assert halts(rig) == []
