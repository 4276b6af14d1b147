"""Stage 5 without a rail monitor, where the supply can be switched: measured by the node.

Owns: the order in which the supply's guards are checked. A probe of an open electrode raises the
node only while the supply is on. Must not know: stops, volts of a rail.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.selftest.array import check_ramp
from etd.selftest.buses import check_idle
from etd.selftest.fall import judge_fall
from etd.selftest.fixture import Fixture
from etd.selftest.gates import ENABLE_ADVICE, GATE_ADVICE, LATCH_ADVICE, check_heartbeat, standing
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.stopgate import SupplyWatch

#: The time for an unmonitored supply to fall, and to rise.
_GONE_WITHIN_MS = 10_000
_RISE_MS = 500
_LOOK_EVERY_MS = 50
#: As parts of the node's open voltage: below the first the supply is off, above the second on.
_NODE_GONE = 0.1
_NODE_THERE = 0.5


def watch(fixture: Fixture, log: CheckLog, prober: Prober) -> SupplyWatch:
    """By a probe of an open electrode."""
    read_v = 0.0

    def is_gone() -> bool:
        nonlocal read_v
        read_v = prober.probe(fixture.free[0])[1].voltage_v
        fixture.wait_ms(_LOOK_EVERY_MS)
        return read_v < _gone_v(prober)

    def is_there() -> bool:
        voltage_v = prober.probe(fixture.free[0])[1].voltage_v
        return voltage_v >= prober.open_v(prober.probe_ua) * _NODE_THERE

    def reading() -> str:
        return f"{read_v:.2f} V at {prober.probe_ua} uA"

    def rises(name: str) -> bool:
        return _check_rise(fixture, log, prober, name)

    return SupplyWatch(is_there, is_gone, reading, _GONE_WITHIN_MS, rises, None)


def _gone_v(prober: Prober) -> float:
    return prober.open_v(prober.probe_ua) * _NODE_GONE


def check(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    if not check_ramp(fixture, log, prober, "off_ramp", is_supplied=False):
        return
    is_off = _judge_gone(fixture, log, prober, "off", "the supply is on though its enable is off")
    is_good = (
        is_off
        and _check_rise(fixture, log, prober, "rise")
        and _check_enable(fixture, log, prober)
        and _check_rise(fixture, log, prober, "rise_again")
    )
    if is_good:
        _check_gate(fixture, log, prober)


def _check_enable(fixture: Fixture, log: CheckLog, prober: Prober) -> bool:
    fixture.board.supply_off()
    fixture.beats.go_on_when_off = True
    try:
        return _judge_gone(
            fixture, log, prober, "hv_enable", ENABLE_ADVICE, missed_ms=fixture.beats.missed_ms
        )
    finally:
        fixture.beats.go_on_when_off = False


def _check_gate(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    if fixture.file.guards.heartbeat == "absent":
        return
    check_heartbeat(
        fixture,
        lambda level: _goes(fixture, log, prober, level),
        lambda: _stays_away(fixture, log, prober),
        lambda name: _check_rise(fixture, log, prober, name),
    )


def _goes(fixture: Fixture, log: CheckLog, prober: Prober, level: int) -> bool:
    """Without beats until the capacitors are discharged; probes afterwards beat again."""
    fixture.end_beats(level)
    missed_ms = fixture.beats.missed_ms()
    fixture.wait_ms(_GONE_WITHIN_MS, is_beating=False)
    return _judge_gone(
        fixture,
        log,
        prober,
        "heartbeat",
        GATE_ADVICE,
        missed_ms=lambda: missed_ms,
        suffix=f", {standing(level)}",
    )


def _stays_away(fixture: Fixture, log: CheckLog, prober: Prober) -> bool:
    fixture.wait_ms(_RISE_MS)
    return _judge_gone(
        fixture,
        log,
        prober,
        "heartbeat_latch",
        LATCH_ADVICE,
        missed_ms=fixture.beats.missed_ms,
        within_ms=0,
    )


def _check_rise(fixture: Fixture, log: CheckLog, prober: Prober, name: str) -> bool:
    """No electrode is connected before the node was measured idle with the supply on."""
    fixture.board.release()
    fixture.supply_on()
    fixture.wait_ms(_RISE_MS)
    check_idle(fixture, log, f"{name}_idle")
    return not log.stage_failed and check_ramp(fixture, log, prober, name)


def _judge_gone(
    fixture: Fixture,
    log: CheckLog,
    prober: Prober,
    name: str,
    advice: str,
    *,
    missed_ms: Callable[[], float | None] = lambda: None,
    within_ms: int = _GONE_WITHIN_MS,
    suffix: str = "",
) -> bool:
    """Repeat a probe of an open electrode until it does not raise the node, or time is over.

    `missed_ms`: see `judge_fall`; called at the end. `suffix`: added to what was measured.
    """
    supply = watch(fixture, log, prober)
    is_good = fixture.wait_until(supply.is_gone, within_ms)
    return judge_fall(
        log,
        missed_ms(),
        name,
        is_good,
        f"{supply.reading()}{suffix}",
        f"below {_gone_v(prober):.2f} V within {within_ms} ms",
        advice,
    )
