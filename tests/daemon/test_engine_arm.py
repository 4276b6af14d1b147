"""The power-up: what is checked, what is waited for, and how it ends when it is cut short."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest

from board_rig import pulse_words
from engine_rig import LEASE, EngineRig
from engine_scenes import MS, armed, config, felt_ua, halts, moves, phases, states
from etd.files.resources import find
from etd.protocol.link import (
    Answer,
    ArmBoard,
    CloseLease,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    StopNow,
)
from etd.sensing.sensors import STALE_NS
from etd_hal.backend import Backend
from etd_hal.boardfile import GUARDS, load_board
from etd_hal.errors import FileError, GuardRefusal
from etd_hal.fake.faults import I2cFailure, RailOff, SpiStall
from etd_hal.ports import Changes, Edge, Gpio
from etd_hal.switch_shadow import Approval

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
REFERENCE = "reference-hv507"
MONITOR = 0x48
PROBE_UA = 300


def begin_arming(rig: EngineRig) -> int:
    """A person's lease, the wearer's stop tried, and an arm under way; its ref."""
    rig.open()
    rig.try_wearer_stop()
    ref = rig.next_ref()
    rig.commands.send(ArmBoard(ref=ref))
    rig.run_ms(20)
    assert rig.state == "PROBE"
    return ref


def keep_the_lease(rig: EngineRig) -> None:
    """As a client does that waits for its arm."""

    def keep(_: int) -> None:
        rig.commands.send(KeepLease(ref=0, lease=LEASE))

    rig.meanwhile = keep


def assert_off(rig: EngineRig) -> None:
    assert rig.state == "SAFE"
    assert moves(rig, "HV")[-1][1] == 0
    assert not rig.engine.components.board.is_supply_on
    assert felt_ua(rig) == {}


# --- checks ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("guard", GUARDS)
def test_each_absent_guard_must_be_accepted_by_name(make_rig: MakeRig, guard: str) -> None:
    accepted = tuple(name for name in GUARDS if name != guard)
    rig = make_rig(loaded=config(accepted=accepted))
    rig.open()
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert guard in answer.reason
    assert "accept_absent_guards" in answer.reason
    assert rig.state == "SAFE"
    assert phases(rig) == []


def test_the_wearer_s_stop_must_have_been_tried(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    rig.open()
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "press and release" in answer.reason
    rig.fake.world.press("wearer_stop")
    rig.run_ms(5)
    assert rig.ask(ArmBoard).error == "arm_failed"
    rig.fake.world.release("wearer_stop")
    rig.run_ms(5)
    assert rig.ask(ArmBoard).error is None


@dataclass
class PluggedIn:
    """Lines on which only closing edges are seen: a stop that is plugged in, not pressed."""

    gpio: Gpio

    def set(self, changes: Changes) -> None:
        self.gpio.set(changes)

    def get(self, line: int) -> int:
        return self.gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return tuple(edge for edge in self.gpio.edges() if edge.value == 1)


def test_a_wearer_s_stop_that_was_only_plugged_in_has_not_been_tried(make_rig: MakeRig) -> None:
    def wrap(backend: Backend) -> Backend:
        return dataclasses.replace(backend, gpio=PluggedIn(backend.gpio))

    rig = make_rig(REFERENCE, wrap=wrap)
    rig.open()
    rig.try_wearer_stop()
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "press and release" in answer.reason


@pytest.mark.parametrize("line", ["emergency_stop", "wearer_stop"])
def test_an_open_stop_line_is_named(make_rig: MakeRig, line: str) -> None:
    rig = make_rig(REFERENCE)
    rig.open()
    rig.try_wearer_stop()
    rig.fake.world.press(line)  # type: ignore[arg-type]
    rig.run_ms(5)
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert f"{line} open" in answer.reason
    assert [value for _, value in moves(rig, "HV")] in ([], [0], [0] * len(moves(rig, "HV")))


def test_arming_needs_a_lease(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    assert rig.ask(ArmBoard).error == "no_lease"


def test_what_is_armed_stays_armed(make_rig: MakeRig) -> None:
    """Asked again, it says so, and nothing is switched or measured."""
    rig = armed(make_rig(electrodes=N))
    since_ns = rig.clock.now_ns()
    assert rig.ask(ArmBoard).error is None
    assert rig.state == "ARMED"
    assert not phases(rig, since_ns)


# --- the rail -------------------------------------------------------------------------------------


def test_the_supply_comes_on_and_armed_is_entered_when_the_rail_is_there(
    make_rig: MakeRig,
) -> None:
    rig = armed(make_rig(REFERENCE))
    assert rig.fake.world.rail_v() > 270
    assert moves(rig, "HV")[-1][1] == 1
    assert min(phase.from_ns for phase in phases(rig)) > moves(rig, "HV")[-1][0] + 50 * MS
    assert [state.state for state in states(rig)][-2:] == ["PROBE", "ARMED"]
    assert states(rig)[-1].supply_on


def test_a_rail_that_is_not_known_is_a_refusal_before_the_supply_is_on(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE, faults=[I2cFailure(MONITOR, "absent")])
    rig.open()
    rig.try_wearer_stop()
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "not known" in answer.reason
    assert "0x48" in answer.reason
    assert 1 not in [value for _, value in moves(rig, "HV")]
    assert_off(rig)


@pytest.mark.parametrize(("factor", "said"), [(0.5, "150 V after"), (0.0, "0 V after")])
def test_a_rail_that_is_wrong_switches_off_and_says_why(
    make_rig: MakeRig, factor: float, said: str
) -> None:
    rig = make_rig(REFERENCE, faults=[RailOff(factor)])
    rig.open()
    rig.try_wearer_stop()
    keep_the_lease(rig)
    begun_ns = rig.clock.now_ns()
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert said in answer.reason
    assert rig.clock.now_ns() - begun_ns < 1_100 * MS
    assert_off(rig)
    assert rig.ask(DisarmBoard, lease=LEASE).error is None


def test_a_rail_that_becomes_unknown_on_the_way_is_not_waited_for_longer(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(REFERENCE)
    ref = begin_arming(rig)
    keep_the_lease(rig)
    rig.fake.world.put_in(I2cFailure(MONITOR, "io"))
    answer = rig.wait_for(ref)
    assert answer.error == "arm_failed"
    assert "unknown after" in answer.reason
    assert_off(rig)


def test_a_rail_that_has_risen_too_high_switches_off_and_says_so(make_rig: MakeRig) -> None:
    rig = armed(make_rig(REFERENCE))
    rig.ask(DisarmBoard, lease=LEASE)
    rig.fake.world.put_in(RailOff(1.5))
    rig.engine.components.board.supply_on()
    for _ in range(20):
        rig.engine.components.board.beat()
        rig.run_ms(10)
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "above 320" in answer.reason
    assert moves(rig, "HV")[-1][1] == 0


def test_a_rail_on_its_way_to_too_high_halts_soon_after_it_was_found_there(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(REFERENCE, faults=[RailOff(1.5)])
    armed(rig)
    rig.run_ms(300)
    assert rig.state == "HALTED"
    assert halts(rig)[0].source == "rail"
    assert "320" in halts(rig)[0].detail


def test_a_rail_that_becomes_unknown_while_contact_is_measured_halts_between_two_probes(
    make_rig: MakeRig,
) -> None:
    """What let the probes begin is stale before they are over."""
    rig = armed(make_rig(REFERENCE))
    rig.ask(DisarmBoard, lease=LEASE)
    rig.engine.components.board.supply_on()
    for _ in range(20):
        rig.engine.components.board.beat()
        rig.run_ms(10)
    rig.is_sensing = False
    stuck_ns = rig.clock.now_ns()
    while rig.engine.components.rail.rail_v(rig.clock.now_ns() + 10 * MS) is not None:
        rig.engine.components.board.beat()
        rig.run_ms(1)
    begun_ns, answer = rig.clock.now_ns(), rig.ask(ArmBoard)
    probed = phases(rig, begun_ns)
    assert answer.error == "arm_failed"
    assert "the rail is not known" in answer.reason
    assert halts(rig)[0].source == "rail"
    assert 0 < len(probed) < 64
    assert max(phase.from_ns for phase in probed) < stuck_ns + STALE_NS


def test_a_monitor_that_could_not_see_too_high_a_rail_is_refused_in_the_board_file(
    tmp_path: Path,
) -> None:
    said = find("boards", REFERENCE).read_text(encoding="utf-8")
    path = tmp_path / "blind.toml"
    path.write_text(said.replace("high_v = 320.0", "high_v = 330.0"), encoding="utf-8")
    with pytest.raises(FileError, match=r"high_v.*3\.30 V at the monitor's input"):
        load_board(path)


def test_without_a_monitor_the_supply_gets_half_a_second(make_rig: MakeRig) -> None:
    rig = make_rig("feetthrough-relay")
    rig.open()
    on_from_ns = rig.clock.now_ns()
    rig.arm()
    assert min(phase.from_ns for phase in phases(rig)) >= on_from_ns + 500 * MS


# --- cut short ------------------------------------------------------------------------------------


def test_an_arm_cut_short_by_stop_is_answered(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    ref = begin_arming(rig)
    rig.ask(StopNow, client="operator")
    answer = rig.wait_for(ref)
    assert answer.error == "arm_failed"
    assert "halted by stop" in answer.reason
    assert rig.state == "HALTED"
    assert moves(rig, "HV")[-1][1] == 0


@pytest.mark.parametrize(("command", "why"), [(DisarmBoard, "disarmed"), (CloseLease, "closed")])
def test_an_arm_cut_short_by_its_holder_is_answered(
    make_rig: MakeRig, command: type[DisarmBoard], why: str
) -> None:
    rig = make_rig(REFERENCE)
    ref = begin_arming(rig)
    assert rig.ask(command, lease=LEASE).error is None
    answer = rig.wait_for(ref)
    assert answer.error == "arm_failed"
    assert f"cut short: {why}" in answer.reason
    assert_off(rig)


def test_an_arm_cut_short_by_a_lapse_is_answered(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE, faults=[RailOff(0.5)])
    rig.open()
    rig.try_wearer_stop()
    rig.run_ms(500)
    ref = rig.next_ref()
    rig.commands.send(ArmBoard(ref=ref))
    answer = rig.wait_for(ref)
    assert answer.error == "arm_failed"
    assert "cut short: lapsed" in answer.reason
    assert_off(rig)


def test_an_arm_cut_short_by_a_silent_gateway_leaves_safe(make_rig: MakeRig) -> None:
    rig = make_rig("feetthrough-relay")
    rig.open()
    ref = rig.next_ref()
    rig.commands.send(ArmBoard(ref=ref))
    rig.is_gateway_alive = False
    answer = rig.wait_for(ref)
    assert "cut short: the gateway is silent" in answer.reason
    assert_off(rig)


def test_an_arm_cut_short_in_the_middle_of_the_probe_fires_no_further_pulse(
    make_rig: MakeRig,
) -> None:
    rig = make_rig("feetthrough-relay")
    rig.open()
    ref = rig.next_ref()
    rig.commands.send(ArmBoard(ref=ref))
    cut_ns = rig.clock.now_ns() + 550 * MS
    rig.clock.at(cut_ns, lambda: rig.commands.send(DisarmBoard(ref=0, lease=LEASE)))
    answer = rig.wait_for(ref)
    assert answer.error == "arm_failed"
    fired = phases(rig)
    assert 0 < len(fired) < 32
    assert fired[-1].from_ns < cut_ns + 10 * MS


def test_a_second_way_up_in_the_middle_of_the_first_waits_for_its_own_rail(
    make_rig: MakeRig,
) -> None:
    rig = make_rig("feetthrough-relay")
    rig.open()
    keep_the_lease(rig)
    first, second = rig.next_ref(), rig.next_ref()
    rig.commands.send(ArmBoard(ref=first))
    cut_ns = rig.clock.now_ns() + 550 * MS

    def again() -> None:
        rig.commands.send(DisarmBoard(ref=0, lease=LEASE))
        rig.commands.send(ArmBoard(ref=second))

    rig.clock.at(cut_ns, again)
    assert rig.wait_for(first).error == "arm_failed"
    assert rig.wait_for(second).error is None
    assert rig.state == "ARMED"
    paused = [
        phase for phase in phases(rig) if cut_ns + 10 * MS < phase.from_ns < cut_ns + 500 * MS
    ]
    assert paused == []


def test_a_second_arm_while_one_is_under_way_is_refused(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    ref = begin_arming(rig)
    assert rig.ask(ArmBoard).error == "wrong_state"
    assert rig.wait_for(ref).error is None


# --- measure --------------------------------------------------------------------------------------


def test_measure_goes_up_and_comes_back_to_safe(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    rig.open()
    rig.try_wearer_stop()
    rig.fake.world.lift(7)
    rig.reports.clear()
    answer = rig.ask(MeasureContact, lease=LEASE)
    assert answer.error is None
    assert [state.state for state in states(rig)] == ["PROBE", "SAFE"]
    assert rig.state == "SAFE"
    assert moves(rig, "HV")[-1][1] == 0
    contact = answer.contact
    assert contact is not None
    assert contact.contact == (True,) * 7 + (False,) + (True,) * 56
    assert all(20_000 < (ohm or 50_000) < 100_000 for ohm in contact.resistance_ohm)
    told = [report.contact for report in rig.reports if report.contact is not None]
    assert told == [contact]


@pytest.mark.parametrize("board", ["kajimoto-hv507", "etactilekit-hv513", "feetthrough-relay"])
def test_a_probe_never_passes_its_bound_on_the_wire(make_rig: MakeRig, board: str) -> None:
    rig = make_rig(board)
    rig.open()
    assert rig.ask(MeasureContact, lease=LEASE).error is None
    fired = phases(rig)
    assert [phase.electrode for phase in fired] == list(
        range(rig.engine.components.loaded.array.count)
    )
    assert all(0 < phase.current_ua <= PROBE_UA for phase in fired)
    assert all(phase.width_us <= 50 for phase in fired)


def test_what_was_measured_is_forgotten_when_the_supply_goes_off(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    rig.open()
    rig.ask(MeasureContact, lease=LEASE)
    assert rig.engine.components.contact.is_touched == [None] * N


def test_a_probe_pulse_that_is_late_halts(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    rig.open()
    rig.fake.world.put_in(SpiStall(500, at_message=3))
    answer: Answer = rig.ask(MeasureContact, lease=LEASE)
    assert answer.error == "arm_failed"
    assert rig.state == "HALTED"


def test_a_board_with_every_guard_needs_none_accepted() -> None:
    loaded = config(REFERENCE, None)
    assert loaded.unaccepted_guards == ()
    assert msgspec.structs.asdict(loaded.config)["accept_absent_guards"] == ()


def test_on_the_way_up_the_last_guard_lets_nothing_through_that_is_more_than_a_probe(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(REFERENCE)
    ref = begin_arming(rig)
    guard = rig.engine.components.board.guard

    def send() -> None:
        guard.approve(Approval(1, 2**64 - 2, 1_000, 100))
        guard.spi.transfer(pulse_words(400))

    with pytest.raises(GuardRefusal) as refused:
        send()
    assert refused.value.rule == "state"
    assert rig.wait_for(ref).error is None
    with pytest.raises(GuardRefusal) as refused:
        send()
    assert refused.value.rule == "switch", "armed, it may be one"
