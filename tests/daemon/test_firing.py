"""The one way for current to the board: what the ledger has before, after, and when it failed."""

from __future__ import annotations

import msgspec
import pytest

from etd.firing import Firing
from etd.protocol.errors import BoardFault, BusError, GuardRefusal
from etd.pulse.request import PulseRequest
from etd.safety.bookings import WINDOW_NS
from etd.selftest.fixture import Fixture
from etd.selftest.prober import Prober
from etd_hal.fake.faults import Fault, MisoStuck, SpiError, SpiShort, SpiStall
from etd_hal.ports import Clock
from firing_scene import (
    CURRENT_UA,
    HALT_EXCESS_US,
    HERE,
    INTERVAL_US,
    KAJIMOTO,
    NEARLY,
    PHASE_PC,
    RELAY,
    SECOND_MESSAGE,
    WIDTH_US,
    Scene,
)
from selftest_rig import SelftestRig, selftest_rig


@pytest.mark.parametrize("board", [KAJIMOTO, RELAY])
@pytest.mark.parametrize("phases", [(True,), (False,), (True, False)])
def test_a_visit_that_went_as_planned_is_booked_as_planned(
    board: str, phases: tuple[bool, ...]
) -> None:
    scene = Scene(board, phases)
    scene.fire()
    assert scene.booked_pc == PHASE_PC * len(phases)
    assert scene.ledger.pulses(HERE, scene.rig.clock.now_ns()) == 1
    assert scene.got_pc() > NEARLY * PHASE_PC * len(phases)
    scene.check_all()


class EarlyClock:
    """As if the way from the booking to the wire took 50 us, as the guard's work does."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def now_ns(self) -> int:
        return self._clock.now_ns() - 50_000

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._clock.sleep_until_ns(deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self._clock.doze_until_ns(deadline_ns)


@pytest.mark.parametrize("phases", [(True,), (True, False)])
def test_a_visit_counts_from_when_its_first_message_began(phases: tuple[bool, ...]) -> None:
    scene = Scene(phases=phases)
    scene.firing = Firing(scene.rig.board, scene.ledger, EarlyClock(scene.rig.clock))
    scene.fire()
    assert scene.pulses_ns()[0] == scene.begun_ns
    assert scene.ledger.rested_ns(HERE) == scene.begun_ns + INTERVAL_US * 1_000
    assert scene.ledger.charge_pc(HERE, scene.begun_ns + WINDOW_NS - 1) == PHASE_PC * len(phases)
    assert scene.ledger.charge_pc(HERE, scene.begun_ns + WINDOW_NS) == 0


@pytest.mark.parametrize("phases", [(True,), (True, False)])
def test_while_a_message_is_under_way_it_is_booked_at_its_worst(phases: tuple[bool, ...]) -> None:
    scene = Scene(phases=phases)
    seen_pc: list[int] = []
    scene.rig.clock.at(scene.begun_ns + 1, lambda: seen_pc.append(scene.booked_pc))
    scene.fire()
    worst_pc = (PHASE_PC + CURRENT_UA * HALT_EXCESS_US) * len(phases)
    assert seen_pc == [worst_pc]


@pytest.mark.parametrize("phases", [(True,), (False,), (True, False)])
def test_after_its_last_message_a_visit_is_discharged_before_anything_else(
    phases: tuple[bool, ...],
) -> None:
    scene = Scene(phases=phases)
    live: list[bool] = []
    scene.firing = Firing(
        scene.rig.board, scene.ledger, scene.rig.clock, lambda *_: live.append(scene.is_connected)
    )
    scene.fire()
    assert live == [True] * (len(phases) - 1) + [False]


@pytest.mark.parametrize("fault", [SpiStall(5_000), MisoStuck(1)], ids=str)
def test_a_message_that_is_refused_afterwards_has_been_discharged(fault: Fault) -> None:
    scene = Scene()
    with pytest.raises(BoardFault):
        scene.fire(fault)
    assert not scene.is_connected


def test_a_probe_before_its_pulse_leaves_the_electrodes_connected() -> None:
    scene = Scene()
    scene.firing.fire(scene.firing.book(scene.ready), scene.ready, stays_connected=True)
    assert scene.is_connected


@pytest.mark.parametrize("board", [KAJIMOTO, RELAY])
def test_what_was_not_fired_after_all_is_taken_back(board: str) -> None:
    scene = Scene(board)
    scene.firing.take_back(scene.firing.book(scene.ready))
    assert scene.booked_pc == 0
    assert scene.ledger.rested_ns(HERE) == 0


def test_before_a_second_phase_it_is_booked_at_its_worst_and_the_first_as_it_was() -> None:
    scene = Scene(phases=(True, False))
    seen_pc: list[int] = []
    # The first message takes some 320 us, and the flip a few.
    scene.rig.clock.at(scene.begun_ns + 370_000, lambda: seen_pc.append(scene.booked_pc))
    scene.fire(SpiStall(200, at_message=1))
    assert seen_pc == [PHASE_PC * 2 + CURRENT_UA * (200 + HALT_EXCESS_US)]
    assert scene.booked_pc == PHASE_PC * 2 + CURRENT_UA * 200


@pytest.mark.parametrize("stall_us", [1, 200, 300])
def test_what_a_message_took_over_its_plan_is_in_the_ledger(stall_us: int) -> None:
    scene = Scene()
    scene.fire(SpiStall(stall_us))
    assert scene.booked_pc == PHASE_PC + CURRENT_UA * stall_us
    scene.check_all()


def test_a_message_too_far_over_its_plan_is_a_fault_and_is_in_the_ledger_whole() -> None:
    scene = Scene(phases=(True, False))
    with pytest.raises(BoardFault, match=r"5000 us over its plan at electrode 5.*at most 300 us"):
        scene.fire(SpiStall(5_000))
    assert scene.booked_pc >= CURRENT_UA * 5_000 + PHASE_PC * 2
    scene.check_all()


@pytest.mark.parametrize("board", [KAJIMOTO, RELAY])
@pytest.mark.parametrize("at_message", [1, 2])
@pytest.mark.parametrize(
    "fault",
    [
        *(SpiError(1, transfer) for transfer in range(5)),
        SpiShort(),
        MisoStuck(1),
    ],
    ids=str,
)
def test_of_a_message_that_failed_the_ledger_has_all_until_the_board_was_safe(
    board: str, at_message: int, fault: Fault
) -> None:
    scene = Scene(board, (True, False))
    if isinstance(fault, SpiError):
        fault = SpiError(at_message, fault.at_transfer)
    elif isinstance(fault, SpiShort):
        fault = SpiShort(at_message)
    with pytest.raises(BoardFault if isinstance(fault, MisoStuck) else BusError):
        scene.fire(fault)
    assert scene.rig.fake.dac_code == 0
    assert scene.booked_pc >= PHASE_PC * 2
    scene.check_all()


@pytest.mark.parametrize("fault", [SpiShort(), MisoStuck(1)], ids=str)
def test_a_message_that_stalled_and_then_failed_counts_for_as_long_as_it_was_under_way(
    fault: Fault,
) -> None:
    scene = Scene()
    with pytest.raises((BusError, BoardFault)):
        scene.fire(SpiStall(4_000, at_transfer=3), fault)
    assert CURRENT_UA * 4_000 <= scene.booked_pc <= scene.since_pc(scene.begun_ns)
    scene.check_all()


@pytest.mark.parametrize(("board", "second"), SECOND_MESSAGE.items())
@pytest.mark.parametrize("phases", [(True, False), (False, True)])
@pytest.mark.parametrize("at_transfer", [*range(5), None])
def test_where_a_second_phase_has_failed_net_charge_is_what_may_be_furthest_from_nothing(
    board: str, second: int, phases: tuple[bool, ...], at_transfer: int | None
) -> None:
    scene = Scene(board, phases)
    with pytest.raises(BusError):
        scene.fire(SpiShort(second) if at_transfer is None else SpiError(second, at_transfer))
    # The second may have had nothing, or all that is booked but for the first.
    second_most_pc = scene.booked_pc - PHASE_PC
    furthest_pc = max(PHASE_PC, PHASE_PC - second_most_pc, key=abs)
    way = 1 if phases[0] else -1
    assert scene.left_pc == pytest.approx(way * furthest_pc, rel=1.0 - NEARLY)
    assert abs(scene.body.charge_pc(HERE)) <= abs(scene.left_pc) + 1.0


def test_where_the_polarity_could_not_be_changed_what_the_first_phase_left_is_net_charge() -> None:
    scene = Scene(RELAY, (False, True))
    with pytest.raises(BusError):
        scene.fire(SpiShort(SECOND_MESSAGE[RELAY] - 1))
    assert -PHASE_PC <= scene.left_pc < -NEARLY * PHASE_PC


@pytest.mark.parametrize(("board", "second"), SECOND_MESSAGE.items())
@pytest.mark.parametrize(("at", "over_us", "way"), [(0, 250, 1), (1, 290, -1), (1, 900, -1)])
def test_what_one_of_two_phases_took_over_its_plan_is_net_charge(
    board: str, second: int, at: int, over_us: int, way: int
) -> None:
    scene = Scene(board, (True, False))
    stall = SpiStall(over_us, at_message=second if at else 1, at_transfer=2)
    if over_us > HALT_EXCESS_US:
        with pytest.raises(BoardFault, match="over its plan"):
            scene.fire(stall)
    else:
        scene.fire(stall)
    assert scene.left_pc == pytest.approx(way * CURRENT_UA * over_us, rel=1.0 - NEARLY)
    assert abs(scene.body.charge_pc(HERE)) <= abs(scene.left_pc) + 1.0


def test_of_a_first_phase_that_failed_it_is_all_that_may_have_flowed() -> None:
    for phases in ((True, False), (False, True)):
        scene = Scene(phases=phases)
        with pytest.raises(BusError):
            scene.fire(SpiStall(4_000, at_transfer=3), SpiShort())
        way = 1 if phases[0] else -1
        assert way * scene.left_pc >= NEARLY * CURRENT_UA * 4_000
        assert way * scene.body.charge_pc(HERE) <= way * scene.left_pc


def test_phases_that_were_fired_or_taken_back_leave_nothing() -> None:
    scene = Scene(phases=(True, False))
    scene.fire()
    assert scene.left_pc == 0
    refused = Scene(phases=(True, False))
    refused.rig.board.guard.permit(CURRENT_UA // 2)
    with pytest.raises(GuardRefusal):
        refused.fire()
    assert refused.left_pc == 0
    assert refused.booked_pc == 0


def test_a_second_phase_that_is_refused_leaves_what_the_first_one_left() -> None:
    scene = Scene(phases=(True, False))
    permit = scene.rig.board.guard.permit

    def refuse_the_next(*_: object) -> None:
        permit(CURRENT_UA // 2)

    scene.firing = Firing(scene.rig.board, scene.ledger, scene.rig.clock, refuse_the_next)
    with pytest.raises(GuardRefusal):
        scene.fire()
    assert NEARLY * PHASE_PC < scene.left_pc <= PHASE_PC + 1.0


def test_a_second_phase_that_failed_counts_from_its_own_beginning() -> None:
    scene = Scene(RELAY, (True, False))
    with pytest.raises(BusError):
        # The second message is the look at the node before the relays close the other way round.
        scene.fire(SpiStall(4_000, at_message=3), SpiShort(3))
    first_ns, second_ns = scene.pulses_ns()
    assert second_ns > first_ns + 1_000_000, "relays take their time"
    assert scene.booked_pc >= CURRENT_UA * 4_000 + PHASE_PC
    assert scene.booked_pc <= PHASE_PC + scene.since_pc(second_ns)
    scene.check_all()


def test_a_board_that_does_not_become_safe_after_an_error_is_told_with_it() -> None:
    scene = Scene()
    with pytest.raises(BoardFault, match=r"reported; .*transfer 0 failed") as raised:
        scene.fire(SpiShort(1), SpiError(2))
    assert isinstance(raised.value.__cause__, BusError)
    scene.check_all()


@pytest.mark.parametrize("board", [KAJIMOTO, RELAY])
@pytest.mark.parametrize("stall_us", [300, 301])
def test_a_check_with_nothing_connected_that_takes_too_long_is_a_fault(
    board: str, stall_us: int
) -> None:
    scene = Scene(board)
    live = scene.rig.board
    live.discharge()
    live.isolate()
    given = PulseRequest(300, WIDTH_US // 2)
    scene.rig.fake.world.put_in(SpiStall(stall_us))
    if stall_us <= HALT_EXCESS_US:
        scene.firing.fire_unloaded(live.pulse(given.current_ua, given.width_us), given)
    else:
        with pytest.raises(BoardFault, match="with nothing connected"):
            scene.firing.fire_unloaded(live.pulse(given.current_ua, given.width_us), given)
    assert scene.booked_pc == 0
    assert scene.rig.fake.dac_code == 0
    scene.check_all()


# --- what was not sent ----------------------------------------------------------------------------


@pytest.mark.parametrize("board", [KAJIMOTO, RELAY])
def test_a_visit_that_the_guard_refused_is_taken_back(board: str) -> None:
    scene = Scene(board, (True, False))
    scene.rig.board.guard.permit(0)
    with pytest.raises(GuardRefusal):
        scene.fire()
    now_ns = scene.rig.clock.now_ns()
    assert [scene.ledger.charge_pc(electrode, now_ns) for electrode in range(scene.count)] == [
        0
    ] * scene.count
    assert scene.ledger.pulses(HERE, now_ns) == 0
    assert scene.ledger.rested_ns(HERE) == 0


def test_when_the_guard_refuses_the_second_phase_what_was_booked_stays() -> None:
    scene = Scene(phases=(True, False))
    # While the first one is under way.
    scene.rig.clock.at(scene.begun_ns + 1, lambda: scene.rig.board.guard.permit(0))
    with pytest.raises(GuardRefusal):
        scene.fire()
    assert scene.got_pc() > NEARLY * PHASE_PC
    assert scene.booked_pc >= PHASE_PC * 2
    scene.check_all()


# --- the self-test's pulses -----------------------------------------------------------------------


def probing(rig: SelftestRig) -> Prober:
    """A bed with its load on electrode 1, timed and supplied."""
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
    fixture.board.calibrate()
    fixture.supply_on()
    fixture.wait_ms(2_000)
    return Prober(fixture)


@pytest.mark.parametrize("board", ["reference-hv507", RELAY])
@pytest.mark.parametrize(
    "faults",
    [[], [SpiStall(250)], [SpiShort()], [SpiError(1, 3)], [SpiStall(3_000), SpiShort()]],
    ids=str,
)
def test_the_pulses_of_a_self_test_are_booked_the_same_way(board: str, faults: list[Fault]) -> None:
    rig = selftest_rig(board)
    prober = probing(rig)
    before_pc = rig.body.absolute_charge_pc(1)
    if board == RELAY:
        # Before relays close, a message of zero looks whether anything flows.
        faults = [msgspec.structs.replace(fault, at_message=2) for fault in faults]
    for fault in faults:
        rig.fake.world.put_in(fault)
    try:
        prober.probe(1)
    except BusError:
        assert SpiStall(250) not in faults
    got_pc = rig.body.absolute_charge_pc(1) - before_pc
    assert got_pc > 0
    assert got_pc <= prober.ledger.charge_pc(1, rig.clock.now_ns())
    assert rig.fake.dac_code == 0
