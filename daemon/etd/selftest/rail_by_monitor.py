"""Stage 5 with a rail monitor: the rail's voltage, its rise and its fall.

Owns: the order in which the supply's guards are checked. Must not know: stops, the node.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.selftest.fall import Reading, judge_fall, reckoned_within_ms, watch_fall
from etd.selftest.fixture import MS, Fixture
from etd.selftest.gates import ENABLE_ADVICE, GATE_ADVICE, LATCH_ADVICE, check_heartbeat, standing
from etd.selftest.log import CheckLog
from etd.selftest.stopgate import SupplyWatch
from etd_hal.boardfile import Heartbeat, RailMonitor

#: Of the least rail: a stop's two contacts may open some ms apart.
_NEARLY = 0.9
_WINDOW_ADVICE = (
    "the monostable's time differs from window_ms of the board file: check its resistor and"
    " capacitor"
)
_RAIL_ADVICE = "check the supply, its set-point and the monitor's divider"


def watch(fixture: Fixture, log: CheckLog, monitor: RailMonitor) -> SupplyWatch:
    """By the monitor; all readings are kept."""
    readings: list[Reading] = []

    def read_v() -> float:
        rail_v = fixture.rail_v()
        readings.append((fixture.clock.now_ns() / MS, rail_v))
        return rail_v

    def is_gone() -> bool:
        return read_v() < monitor.off_v

    def is_there() -> bool:
        return read_v() >= monitor.low_v * _NEARLY

    def rises(name: str) -> bool:
        return _check_rise(fixture, log, monitor, name)

    def reading() -> str:
        return f"{readings[-1][1]:.0f} V"

    return SupplyWatch(is_there, is_gone, reading, monitor.fall_ms, rises, readings)


def check(fixture: Fixture, log: CheckLog, monitor: RailMonitor) -> None:
    """Raises: BusError, BoardFault."""
    if fixture.file.guards.hv_enable == "absent":
        rail_v = fixture.rail_v()
        is_right = monitor.low_v <= rail_v <= monitor.high_v
        log.judge("rail", is_right, f"{rail_v:.0f} V", _range(monitor), _RAIL_ADVICE)
        return
    # It may have been on before the test: wait for its fall.
    _wait_for(fixture, lambda rail_v: rail_v < monitor.off_v, monitor.fall_ms)
    rail_v = fixture.rail_v()
    is_off = log.judge(
        "off",
        rail_v < monitor.off_v,
        f"{rail_v:.1f} V",
        f"below {monitor.off_v} V with the supply off",
        "the supply is on although its enable is off, or the monitor's divider is wrong",
    )
    if is_off and _check_rise(fixture, log, monitor) and _check_enable(fixture, log, monitor):
        _check_gate(fixture, log, monitor)


def _range(monitor: RailMonitor) -> str:
    return f"{monitor.low_v} to {monitor.high_v} V"


def _wait_for(
    fixture: Fixture, is_there: Callable[[float], bool], within_ms: float
) -> float | None:
    """After how many ms the rail was in range; None if it was not in time."""
    begun_ns = fixture.clock.now_ns()
    while not is_there(fixture.rail_v()):
        if fixture.clock.now_ns() - begun_ns > within_ms * MS:
            return None
        fixture.watch_stops()
    return (fixture.clock.now_ns() - begun_ns) / MS


def _check_rise(fixture: Fixture, log: CheckLog, monitor: RailMonitor, name: str = "rise") -> bool:
    fixture.supply_on()
    took_ms = _wait_for(fixture, lambda rail_v: rail_v >= monitor.low_v, monitor.rise_ms)
    fixture.wait_ms(monitor.rise_ms)
    rail_v = fixture.rail_v()
    # An open stop cuts the supply: then that is the fault to report.
    fixture.watch_stops()
    is_right = took_ms is not None and monitor.low_v <= rail_v <= monitor.high_v
    took = "not in time" if took_ms is None else f"after {took_ms:.0f} ms"
    return log.judge(
        name,
        is_right,
        f"{rail_v:.0f} V, in range {took}",
        f"{_range(monitor)} within {monitor.rise_ms} ms",
        _RAIL_ADVICE,
    )


def _check_enable(fixture: Fixture, log: CheckLog, monitor: RailMonitor) -> bool:
    """Off by the enable line alone: the heartbeat continues."""
    fixture.board.supply_off()
    took_ms = _wait_falling(fixture, monitor, monitor.fall_ms)
    is_good = judge_fall(
        log,
        fixture.beats.missed_ms(),
        "hv_enable",
        took_ms is not None,
        _fell(fixture, monitor, took_ms),
        f"below {monitor.off_v} V within {monitor.fall_ms} ms of the enable line's end",
        ENABLE_ADVICE,
    )
    return is_good and _check_rise(fixture, log, monitor, "rise_again")


def _wait_falling(fixture: Fixture, monitor: RailMonitor, within_ms: float) -> float | None:
    begun_ns = fixture.clock.now_ns()
    while fixture.rail_v(is_beating=False) >= monitor.off_v:
        if fixture.clock.now_ns() - begun_ns > within_ms * MS:
            return None
        fixture.beats.beat()
    return (fixture.clock.now_ns() - begun_ns) / MS


def _fell(fixture: Fixture, monitor: RailMonitor, took_ms: float | None) -> str:
    if took_ms is None:
        return f"still {fixture.rail_v(is_beating=False):.0f} V"
    return f"below {monitor.off_v} V after {took_ms:.0f} ms"


def _check_gate(fixture: Fixture, log: CheckLog, monitor: RailMonitor) -> None:
    heartbeat = fixture.file.guards.heartbeat
    if heartbeat == "absent":
        return
    check_heartbeat(
        fixture,
        lambda level: _goes(fixture, log, monitor, heartbeat, level),
        lambda: _stays_away(fixture, log, monitor),
        lambda name: _check_rise(fixture, log, monitor, name),
    )


def _stays_away(fixture: Fixture, log: CheckLog, monitor: RailMonitor) -> bool:
    fixture.wait_ms(monitor.rise_ms)
    rail_v = fixture.rail_v()
    return judge_fall(
        log,
        fixture.beats.missed_ms(),
        "heartbeat_latch",
        rail_v < monitor.off_v,
        f"{rail_v:.0f} V after beating again for {monitor.rise_ms} ms",
        "it stays off until the enable line has been off",
        LATCH_ADVICE,
    )


def _goes(
    fixture: Fixture, log: CheckLog, monitor: RailMonitor, heartbeat: Heartbeat, level: int
) -> bool:
    """Whether the supply falls, within the heartbeat's window."""
    within_ms = heartbeat.window_ms + monitor.fall_ms
    from_v = fixture.rail_v()
    fixture.end_beats(level)
    missed_ms = fixture.beats.missed_ms()
    fall = watch_fall(fixture, monitor, from_v, within_ms, fixture.beats.last_ns)
    is_good = judge_fall(
        log,
        missed_ms,
        "heartbeat",
        from_v >= monitor.low_v and fall.gone_ms is not None,
        f"from {from_v:.0f} V, {_fell(fixture, monitor, fall.gone_ms)}, {standing(level)}",
        f"from at least {monitor.low_v} V, below {monitor.off_v} V within {within_ms} ms of the"
        " last beat, the enable being on",
        GATE_ADVICE,
    )
    if not is_good:
        return False
    most_ms = reckoned_within_ms(monitor, heartbeat.window_ms)
    return log.judge(
        "heartbeat_window",
        fall.is_cut_within(most_ms),
        f"the rail {fall.cut_text} without a beat (estimated), {standing(level)}",
        f"{heartbeat.window_ms} ms (estimate at most {most_ms:.0f} ms)",
        _WINDOW_ADVICE,
    )
