"""Rail, switch and lines that fail under the engine, and that the skin is silent then."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest

import engine_rig
from engine_rig import EngineRig, turn
from engine_scenes import (
    MS,
    armed,
    dac_codes,
    first_fault,
    fully_open,
    halts,
    moves,
    phases,
    states,
)
from etd.protocol.link import ArmBoard
from etd_hal.backend import Backend
from etd_hal.errors import BusError, GuardRefusal
from etd_hal.fake.faults import (
    I2cFailure,
    LostClock,
    RailOff,
    StuckLine,
)
from etd_hal.ports import Changes, Edge, Gpio, Message, Spi

MakeRig = Callable[..., EngineRig]
N = 16
REFERENCE = "reference-hv507"
MONITOR = 0x48


# --- supply and rail ------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_a_rail_that_leaves_its_bounds_while_armed_halts(make_rig: MakeRig, factor: float) -> None:
    rig = fully_open(make_rig(REFERENCE), 500)
    rig.fake.world.put_in(RailOff(factor))
    for _ in range(30):
        if rig.state == "ARMED":
            rig.show(current_ua=(500,) * 64, rate_hz=10.0)
        rig.run_ms(50)
    assert first_fault(rig) == "rail"
    assert "280.0 to 320.0 V" in halts(rig)[0].detail
    assert moves(rig, "HV")[-1][1] == 0


def test_an_i2c_error_while_armed_halts(make_rig: MakeRig) -> None:
    rig = armed(make_rig(REFERENCE))
    rig.fake.world.put_in(I2cFailure(MONITOR, "io"))
    rig.run_ms(5)
    assert first_fault(rig) == "rail"
    assert "not known" in halts(rig)[0].detail


def test_a_stuck_i2c_bus_makes_the_rail_unknown_and_halts(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(REFERENCE), 500)
    rig.is_sensing = False
    stuck_from_ns = rig.clock.now_ns()
    rig.hold(470, current_ua=(500,) * 64, rate_hz=10.0)
    assert rig.state == "ARMED"
    rig.show(current_ua=(500,) * 64, rate_hz=10.0)
    rig.run_ms(100)
    assert first_fault(rig) == "rail"
    assert "stale" in halts(rig)[0].detail
    assert phases(rig)[-1].to_ns < stuck_from_ns + 505 * MS


# --- switch and guard -----------------------------------------------------------------------------


def test_a_register_that_reads_back_wrong_halts(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(REFERENCE), 500)
    rig.fake.world.put_in(StuckLine("READBACK", 1))
    rig.show(current_ua=(500,) * 64, rate_hz=10.0)
    rig.run_ms(200)
    assert first_fault(rig) == "BoardFault"
    assert "readback" in halts(rig)[0].detail


def test_a_lost_clock_is_found_within_a_scan_where_the_chain_is_read_back(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(REFERENCE), 500)
    rig.fake.world.put_in(LostClock(at_edge=30))
    rig.show(current_ua=(500,) * 64, rate_hz=20.0, ttl_ms=1_000)
    rig.run_ms(120)
    assert first_fault(rig) == "BoardFault"


def test_a_lost_clock_lives_at_most_one_scan_where_it_is_not(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.run_ms(250)
    rig.fake.world.put_in(LostClock(at_edge=5))
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=(500,) * N, rate_hz=20.0, pulses=3, ttl_ms=1_000)
    rig.run_ms(250)
    by_scan: dict[int, set[int]] = {}
    for body in rig.body():
        if body["from_ns"] > since_ns:
            by_scan.setdefault((body["from_ns"] - since_ns) // (50 * MS), set()).add(
                body["electrode"]
            )
    assert by_scan[0] != set(range(N))
    assert by_scan[1] == by_scan[2] == set(range(N))


class RefusingSpi:
    """What the guard refuses looks like this from above; what it refuses, tests/hal knows."""

    def __init__(self, spi: Spi) -> None:
        self._spi = spi
        self.refuses = False

    def prepare(self, message: Message) -> None:
        self._spi.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        if self.refuses and any(transfer.tx.strip(b"\0") for transfer in message.transfers):
            raise GuardRefusal("approval", "500 uA", "450 uA")
        return self._spi.transfer(message)


def test_a_guard_refusal_halts_with_its_rule(make_rig: MakeRig) -> None:
    refusing: list[RefusingSpi] = []

    def wrap(backend: Backend) -> Backend:
        refusing.append(RefusingSpi(backend.spi))
        return dataclasses.replace(backend, spi=refusing[0])

    rig = fully_open(make_rig(electrodes=N, wrap=wrap), 500)
    refusing[0].refuses = True
    since_ns = rig.clock.now_ns()
    rig.send(current_ua=(500,) * N, pulses=1)
    rig.run_ms(50)
    assert first_fault(rig) == GuardRefusal.__name__
    assert "approval" in halts(rig)[0].detail
    assert [phase for phase in phases(rig, since_ns) if phase.current_ua > 100] == []


# --- GPIO that is gone ----------------------------------------------------------------------------


class FailingGpio:
    """Lines that go away when told to."""

    def __init__(self, gpio: Gpio) -> None:
        self._gpio = gpio
        self.fails: set[str] = set()

    def _check(self, operation: str) -> None:
        if operation in self.fails:
            raise BusError("gone", "/dev/gpiochip0", operation)

    def set(self, changes: Changes) -> None:
        self._check("set")
        self._gpio.set(changes)

    def get(self, line: int) -> int:
        self._check("get")
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        self._check("edges")
        return self._gpio.edges()


@pytest.mark.parametrize("operation", ["set", "edges"])
def test_lines_that_are_gone_halt_and_the_dac_is_zeroed_all_the_same(operation: str) -> None:
    failing: list[FailingGpio] = []

    def wrap(backend: Backend) -> Backend:
        failing.append(FailingGpio(backend.gpio))
        return dataclasses.replace(backend, gpio=failing[0])

    rig = fully_open(engine_rig.make(REFERENCE, wrap=wrap), 500)
    failing[0].fails = {operation}
    since_ns = rig.clock.now_ns()
    rig.send(current_ua=(500,) * 64, rate_hz=10.0)
    rig.run_ms(20)
    assert first_fault(rig) == "BusError"
    assert operation in halts(rig)[0].detail
    assert dac_codes(rig, since_ns)[-1][1] == 0
    assert rig.fake.dac_code == 0
    rig.step()
    # What could not be told to go off is not told as off.
    assert states(rig)[-1].supply_on is (operation == "set")
    failing[0].fails = set()
    assert rig.close() == ()


def test_a_halted_board_that_could_not_be_made_safe_is_made_so_with_the_next_fault() -> None:
    failing: list[FailingGpio] = []

    def wrap(backend: Backend) -> Backend:
        failing.append(FailingGpio(backend.gpio))
        return dataclasses.replace(backend, gpio=failing[0])

    rig = armed(engine_rig.make(REFERENCE, wrap=wrap))
    failing[0].fails = {"set", "edges"}
    turn(rig.engine)
    assert rig.state == "HALTED"
    assert moves(rig, "HV")[-1][1] == 1
    failing[0].fails = {"edges"}
    turn(rig.engine)
    assert moves(rig, "HV")[-1][1] == 0
    failing[0].fails = set()
    assert rig.close() == ()


def test_a_board_that_is_gone_for_good_keeps_no_core_busy() -> None:
    failing: list[FailingGpio] = []

    def wrap(backend: Backend) -> Backend:
        failing.append(FailingGpio(backend.gpio))
        return dataclasses.replace(backend, gpio=failing[0])

    rig = engine_rig.make(REFERENCE, wrap=wrap)
    before_ns = rig.clock.now_ns()
    failing[0].fails = {"edges"}
    for _ in range(20):
        turn(rig.engine)
    assert rig.state == "HALTED"
    assert rig.clock.now_ns() - before_ns >= 20 * MS
    failing[0].fails = set()
    assert rig.close() == ()


def test_an_arm_whose_supply_line_is_gone_is_answered() -> None:
    failing: list[FailingGpio] = []

    def wrap(backend: Backend) -> Backend:
        failing.append(FailingGpio(backend.gpio))
        return dataclasses.replace(backend, gpio=failing[0])

    rig = engine_rig.make(REFERENCE, wrap=wrap)
    rig.open()
    rig.try_wearer_stop()
    failing[0].fails = {"set"}
    answer = rig.ask(ArmBoard)
    assert answer.error in ("arm_failed", "halted")
    assert first_fault(rig) == "BusError"
    failing[0].fails = set()
    assert rig.close() == ()
