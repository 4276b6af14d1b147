"""SPI under the engine: errors at every transfer, and messages that take too long."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing

import pytest

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import (
    armed,
    config,
    first_fault,
    fully_open,
    halts,
    moves,
    only,
    phases,
    states,
)
from etd.protocol.link import ArmBoard, ClearHalt, DisarmBoard, StopNow
from etd_hal.fake.faults import (
    MisoStuck,
    SpiError,
    SpiShort,
    SpiStall,
)
from trace_rules import violations

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
ALL = (1_000,) * N


# --- SPI ------------------------------------------------------------------------------------------


def one_scan(board: str = "kajimoto-hv507") -> EngineRig:
    """Open for 0.5 mA, and silent; the next frame is one scan of three electrodes."""
    rig = engine_rig.make(loaded=config(board, 32 if board == "feetthrough-relay" else 16))
    fully_open(rig, 400)
    rig.run_ms(205)
    return rig


def show_three(rig: EngineRig, polarity: str = "anodic") -> None:
    count = rig.engine.components.loaded.array.count
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
        entry["transfers"]
        for entry in rig.records
        if entry.get("event") == "message" and entry["t_ns"] > since_ns
    ]
    assert rig.close() == ()
    return found


def transfers_of_scans() -> Iterator[tuple[str, str, int, int]]:
    """All of one board, and every third of two others; `make campaign` tries each of them."""
    for board, polarity, step in (
        ("kajimoto-hv507", "anodic", 1),
        ("kajimoto-hv507", "biphasic", 3),
        ("feetthrough-relay", "cathodic", 3),
    ):
        for message, transfers in enumerate(messages_of_the_scan(board, polarity), start=1):
            for transfer in range(0, transfers, step):
                yield board, polarity, message, transfer


def assert_cut_off(rig: EngineRig, failed_ns: int) -> None:
    """After the error the very next thing on the wires is the GPIO half of the safe state."""
    after = [entry for entry in rig.records if entry["t_ns"] > failed_ns and entry["bus"] != "body"]
    lines = rig.engine.components.loaded.board.used_lines()
    after = [entry for entry in after if entry.get("event") not in ("done", "cs")]
    expected = [(lines["POL"], 1), (lines["BL"], 0)] if "BL" in lines else [(lines["HV"], 0)]
    assert [(entry["line"], entry["value"]) for entry in after[: len(expected)]] == expected
    assert after[0]["t_ns"] - failed_ns < 100_000


def broken_beside(rig: EngineRig, failed_ns: int) -> list[str]:
    """The rules broken anywhere but in the message that failed."""
    found = violations(rig.trace(), rig.engine.components.loaded.board.rest_us)
    return [text for text in found if abs(int(text.split()[0]) - failed_ns) > 20_000]


def failed_at_ns(rig: EngineRig) -> int:
    """When the message that failed ended: the last one that had not all its transfers."""
    counted: list[tuple[int, int, int]] = []
    for entry in rig.records:
        if entry.get("event") == "message":
            counted.append((entry["transfers"], 0, entry["t_ns"]))
        elif entry.get("event") == "transfer":
            transfers, seen, _ = counted[-1]
            counted[-1] = (transfers, seen + 1, entry["t_ns"])
    short = [t_ns for transfers, seen, t_ns in counted if seen < transfers]
    assert len(short) == 1
    return short[0]


def test_whichever_transfer_fails_the_skin_is_cut_off_at_once_and_it_halts() -> None:
    tried = 0
    for board, polarity, message, transfer in transfers_of_scans():
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
    assert tried > 20


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
    assert "not safe" in rig.ask(StopNow, client="operator").reason
    halt = rig.engine.supervisor.states.halt
    assert halt is not None
    assert (halt.cause, halt.source) == ("stop", "operator")
    assert "transfer" in halt.detail
    answer = rig.ask(ClearHalt)
    assert answer.error == "halted"
    assert "not safe" in answer.reason
    # A second stop tries again, and is told what did not work; so was the first.
    again = rig.ask(StopNow, client="another")
    assert again.error == "halted"
    assert "not safe" in again.reason
    assert "transfer" in again.reason
    assert moves(rig, "BL")[-1][1] == 0
    rig.close()


def lapse(rig: EngineRig) -> None:
    """From directly before on: in silence checks are sent, which would meet the fault first."""
    with closing(armed(engine_rig.make(electrodes=N))) as same:
        begun_ns = same.clock.now_ns()
        while same.state == "ARMED":
            same.run_ms(1)
        lapsed_ms = (same.clock.now_ns() - begun_ns) / 1e6
    rig.run_ms(lapsed_ms - 8.0)
    rig.fake.world.put_in(SpiError(1))
    rig.run_ms(100)


def disarm(rig: EngineRig) -> None:
    rig.fake.world.put_in(SpiError(1))
    rig.ask(DisarmBoard, lease=LEASE)


@pytest.mark.parametrize("way", [lapse, disarm])
def test_a_board_that_cannot_be_disarmed_halts_and_its_lease_is_over(
    way: Callable[[EngineRig], None],
) -> None:
    rig = armed(engine_rig.make(electrodes=N))
    way(rig)
    assert first_fault(rig) == "safe_off"
    assert rig.ask(ClearHalt).error is None
    assert rig.ask(ArmBoard).error == "no_lease"
    rig.close()


# --- messages that take too long ------------------------------------------------------------------


def test_an_overdue_message_is_cut_off_by_the_stopper_and_halts(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.fake.world.put_in(SpiStall(50_000, at_message=2))
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, pulses=1)
    rig.run_ms(100)
    assert first_fault(rig) == "BoardFault"
    flowed = [phase for phase in phases(rig, since_ns) if phase.source and phase.ground]
    given_ns = max(phase.to_ns - phase.from_ns for phase in flowed)
    assert given_ns < 2_000_000
    assert rig.engine.components.stopper_liveness.has_acted


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
    ledger = rig.engine.components.ledger
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
    assert rig.engine.components.reporter.counters["recalibrated"] >= 1
    assert states(rig)
    assert rig.state == "ARMED"


def test_a_drift_out_of_bounds_halts_also_after_the_halt_was_cleared(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    counters = rig.engine.components.reporter.counters
    for attempts in (3, 6):
        for message in range(1, 1_200):
            rig.fake.world.put_in(SpiStall(60, at_message=message, at_transfer=0))
        until_ns = rig.clock.now_ns() + 10_000_000_000
        while rig.state == "ARMED" and rig.clock.now_ns() < until_ns:
            rig.send(current_ua=ALL, rate_hz=50.0)
            rig.run_ms(60)
        assert rig.state == "HALTED"
        assert "overhead of a message" in halts(rig)[-1].detail
        assert counters["calibration_attempts_failed"] == attempts
        rig.fake.world.mend()
        assert rig.ask(ClearHalt).error is None
        rig.open()
        rig.arm()
    assert {halt.source for halt in halts(rig)} == {"BoardFault"}
