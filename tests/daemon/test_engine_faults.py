"""What goes wrong under the engine, and that the skin is silent then."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import pytest

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import (
    MS,
    armed,
    config,
    dac_codes,
    fully_open,
    halts,
    moves,
    only,
    phases,
    states,
)
from etd.link import ArmBoard, ClearHalt, DisarmBoard, StopNow
from etd_hal.compose import Backend
from etd_hal.errors import BusError, GuardRefusal
from etd_hal.fake.faults import (
    I2cFailure,
    LostClock,
    MisoStuck,
    RailOff,
    SpiError,
    SpiShort,
    SpiStall,
    StuckLine,
)
from etd_hal.ports import Changes, Edge, Gpio
from etd_hal.watch import Approval
from trace_decoder import parse
from trace_rules import violations

MakeRig = Callable[..., EngineRig]
N = 16
ALL = (1_000,) * N
REFERENCE = "reference-hv507"
MONITOR = 0x48


def first_fault(rig: EngineRig) -> str:
    """Who, of the first halt; there must have been one."""
    assert rig.state == "HALTED"
    assert rig.engine.lease is None
    halt = rig.engine.states.halt
    assert halt is not None
    assert halts(rig)[0] == halt
    assert halt.cause == "fault"
    return halt.who


# --- SPI ------------------------------------------------------------------------------------------


def one_scan(board: str = "kajimoto-hv507") -> EngineRig:
    """Open for 0.5 mA, and silent; the next frame is one scan of three electrodes."""
    rig = engine_rig.make(loaded=config(board, 32 if board == "feetthrough-relay" else 16))
    fully_open(rig, 400)
    rig.run_ms(205)
    return rig


def show_three(rig: EngineRig, polarity: str = "anodic") -> None:
    count = rig.engine.loaded.array.count
    rig.send(
        current_ua=only(count, e2=400, e3=400, e9=400),
        width_us=50,
        polarity=polarity,
        pulses=1,
        rate_hz=10.0,
        ttl_ms=1_000,
    )
    rig.run_ms(25)


def messages_of_the_scan(board: str, polarity: str) -> list[int]:
    """How many transfers each SPI message of the scan has."""
    rig = one_scan(board)
    since_ns = rig.clock.now_ns()
    show_three(rig, polarity)
    found = [
        one["transfers"]
        for one in rig.records
        if one.get("event") == "message" and one["t_ns"] > since_ns
    ]
    assert rig.close() == ()
    return found


def every_transfer() -> Iterator[tuple[str, str, int, int]]:
    for board, polarity in (
        ("kajimoto-hv507", "anodic"),
        ("kajimoto-hv507", "biphasic"),
        ("feetthrough-relay", "cathodic"),
    ):
        for message, transfers in enumerate(messages_of_the_scan(board, polarity), start=1):
            for transfer in range(transfers):
                yield board, polarity, message, transfer


def assert_cut_off(rig: EngineRig, failed_ns: int) -> None:
    """After the error the very next thing on the wires is the GPIO half of the safe state."""
    after = [one for one in rig.records if one["t_ns"] > failed_ns and one["bus"] != "body"]
    lines = rig.engine.loaded.board.used_lines()
    after = [one for one in after if one.get("event") not in ("done", "cs")]
    expected = [(lines["POL"], 1), (lines["BL"], 0)] if "BL" in lines else [(lines["HV"], 0)]
    assert [(one["line"], one["value"]) for one in after[: len(expected)]] == expected
    assert after[0]["t_ns"] - failed_ns < 100_000


def broken_beside(rig: EngineRig, failed_ns: int) -> list[str]:
    """The rules broken anywhere but in the message that failed."""
    found = violations(parse(rig.sink.getvalue()), rig.engine.loaded.board.rest_us)
    return [one for one in found if abs(int(one.split()[0]) - failed_ns) > 20_000]


def failed_at_ns(rig: EngineRig) -> int:
    """When the message that failed ended: the last one that had not all its transfers."""
    counted: list[tuple[int, int, int]] = []
    for one in rig.records:
        if one.get("event") == "message":
            counted.append((one["transfers"], 0, one["t_ns"]))
        elif one.get("event") == "transfer":
            transfers, seen, _ = counted[-1]
            counted[-1] = (transfers, seen + 1, one["t_ns"])
    short = [t_ns for transfers, seen, t_ns in counted if seen < transfers]
    assert len(short) == 1
    return short[0]


def test_whichever_transfer_fails_the_skin_is_cut_off_at_once_and_it_halts() -> None:
    tried = 0
    for board, polarity, message, transfer in every_transfer():
        rig = one_scan(board)
        rig.fake.world.put_in(SpiError(message, transfer))
        show_three(rig, polarity)
        where = (board, polarity, message, transfer)
        assert first_fault(rig) == "BusError", where
        assert "transfer" in halts(rig)[0].detail
        assert_cut_off(rig, failed_at_ns(rig))
        assert rig.fake.dac_code == 0, where
        assert rig.close() == (), where
        assert broken_beside(rig, failed_at_ns(rig)) == [], where
        tried += 1
    assert tried > 40


@pytest.mark.parametrize("kind", ["io", "timeout", "gone"])
def test_the_kind_of_an_spi_error_is_told(kind: str) -> None:
    rig = one_scan()
    rig.fake.world.put_in(SpiError(2, 1, kind))  # type: ignore[arg-type]
    show_three(rig)
    assert first_fault(rig) == "BusError"
    assert f"({kind})" in halts(rig)[0].detail
    rig.close()


def test_fewer_bytes_than_sent_halt(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.fake.world.put_in(SpiShort(at_message=2))
    rig.show(current_ua=ALL, pulses=1)
    rig.run_ms(50)
    assert first_fault(rig) == "BusError"


@pytest.mark.parametrize("level", [0, 1])
def test_an_adc_that_does_not_answer_halts_or_is_told_open(make_rig: MakeRig, level: int) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    stuck = MisoStuck(level)  # type: ignore[arg-type]
    rig.fake.world.put_in(stuck)
    rig.show(current_ua=ALL, pulses=1)
    rig.run_ms(50)
    if level:
        assert first_fault(rig) == "BoardFault"
    rig.fake.world.take_out(stuck)


def test_spi_that_never_comes_back_is_told_and_the_stop_s_cause_stands() -> None:
    rig = fully_open(engine_rig.make(electrodes=N), 500)
    for message in range(1, 200):
        rig.fake.world.put_in(SpiError(message))
    rig.ask(StopNow, who="operator")
    halt = rig.engine.states.halt
    assert halt is not None
    assert (halt.cause, halt.who) == ("stop", "operator")
    assert "transfer" in halt.detail
    answer = rig.ask(ClearHalt)
    assert answer.error == "halted"
    assert "not safe" in answer.reason
    assert moves(rig, "BL")[-1][1] == 0
    rig.close()


def lapse(rig: EngineRig) -> None:
    rig.run_ms(1_100)


def disarm(rig: EngineRig) -> None:
    rig.ask(DisarmBoard, lease=LEASE)


@pytest.mark.parametrize("way", [lapse, disarm])
def test_a_board_that_cannot_be_disarmed_halts_and_its_lease_is_over(
    way: Callable[[EngineRig], None],
) -> None:
    rig = armed(engine_rig.make(electrodes=N))
    rig.fake.world.put_in(SpiError(1))
    way(rig)
    assert first_fault(rig) == "safe_off"
    assert rig.ask(ClearHalt).error is None
    assert rig.ask(ArmBoard).error == "no_lease"
    rig.close()


# --- messages that take too long ------------------------------------------------------------------


def look_all_the_time(rig: EngineRig, for_ms: int) -> None:
    """What the stopper's thread does."""
    now_ns = rig.clock.now_ns()
    for step in range(2 * for_ms):
        rig.clock.at(now_ns + step * MS // 2, rig.engine.stopper.look)


def test_an_overdue_message_is_cut_off_by_the_stopper_and_halts(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.fake.world.put_in(SpiStall(50_000, at_message=2))
    look_all_the_time(rig, 100)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, pulses=1)
    rig.run_ms(100)
    assert first_fault(rig) == "BoardFault"
    flowed = [one for one in phases(rig, since_ns) if one.source and one.ground]
    given_ns = max(one.to_ns - one.from_ns for one in flowed)
    assert given_ns < 2_000_000
    assert rig.engine.stopper.has_acted


def test_what_the_stopper_did_is_a_halt_even_if_the_message_then_ends_in_time(
    make_rig: MakeRig,
) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.engine.stopper.has_acted = True
    rig.run_ms(3)
    assert first_fault(rig) == "stopper"
    assert rig.ask(ClearHalt).error is None
    rig.open()
    rig.arm()
    assert rig.state == "ARMED"


@pytest.mark.parametrize(("stall_us", "state"), [(250, "ARMED"), (320, "HALTED")])
def test_beyond_its_bound_a_message_that_took_too_long_halts(
    make_rig: MakeRig, stall_us: int, state: str
) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.fake.world.put_in(SpiStall(stall_us, at_message=2))
    rig.show(current_ua=ALL, pulses=1)
    rig.run_ms(50)
    assert rig.state == state
    if state == "HALTED":
        assert first_fault(rig) == "BoardFault"
        assert "over its plan" in halts(rig)[0].detail


def test_the_excess_is_charged_to_the_ledger(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.run_ms(1_100 - 230)
    rig.show(current_ua=only(N, e5=1_000), width_us=100, pulses=1)
    rig.run_ms(60)
    ledger = rig.engine._tools.ledger
    before_pc = ledger.charge_pc(5, rig.clock.now_ns())
    assert 95_000 < before_pc <= 101_000
    rig.fake.world.put_in(SpiStall(200, at_message=1))
    rig.show(current_ua=only(N, e5=1_000), width_us=100, pulses=1)
    rig.run_ms(60)
    added_pc = ledger.charge_pc(5, rig.clock.now_ns()) - before_pc
    assert 290_000 < added_pc < 310_000
    assert rig.state == "ARMED"


def test_slow_drift_is_calibrated_away(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    for message in range(1, 400):
        rig.fake.world.put_in(SpiStall(3, at_message=message))
    rig.hold(400, current_ua=ALL, rate_hz=50.0)
    assert rig.engine.reporter.counters["recalibrated"] >= 1
    assert states(rig)
    assert rig.state == "ARMED"


def test_a_drift_out_of_bounds_halts(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    for message in range(1, 1_200):
        rig.fake.world.put_in(SpiStall(60, at_message=message, at_transfer=0))
    rig.show(current_ua=ALL, rate_hz=50.0, ttl_ms=1_000)
    rig.run_ms(600)
    assert first_fault(rig) == "BoardFault"
    assert "overhead of a message" in halts(rig)[0].detail


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


def test_a_guard_refusal_halts_with_its_rule(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)

    def approve_other(approval: Approval) -> None:
        weaker = dataclasses.replace(approval, current_ua=approval.current_ua - 50)
        type(rig.engine.board.guard).approve(rig.engine.board.guard, weaker)

    rig.engine.board.guard.approve = approve_other  # type: ignore[method-assign]
    since_ns = rig.clock.now_ns()
    rig.send(current_ua=(500,) * N, pulses=1)
    rig.run_ms(50)
    assert first_fault(rig) == GuardRefusal.__name__
    assert "approval" in halts(rig)[0].detail
    assert [one for one in phases(rig, since_ns) if one.current_ua > 100] == []


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
