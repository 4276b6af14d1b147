"""Stage 5, no electrode connected: the supply comes, goes, and goes by itself without a heartbeat.

Owns: the order in which the supply's guards are proved. Must not know: how volts are read.

Where a monitor watches the rail it is asked. Where the supply can be switched and nobody watches
it, the node tells: a probe lifts it only while the supply is there.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.selftest import killed, stopgate
from etd.selftest.bed import MS, Bed
from etd.selftest.buses import check_idle
from etd.selftest.fall import Reading, judge_fall, reckoned_within_ms, watch_fall
from etd.selftest.log import Log
from etd.selftest.probe import check_ramp
from etd.selftest.prober import Prober
from etd.selftest.stopgate import SupplyWatch
from etd_hal.boardfile import Heartbeat, RailMonitor

#: A supply that nobody watches gets this long to come, and to go.
_UNWATCHED_MS = 10_000
_UNWATCHED_RISE_MS = 500
_LOOK_EVERY_MS = 50
#: Of the node's open voltage: below the one the supply is gone, above the other it is there.
_NODE_GONE = 0.1
_NODE_THERE = 0.5
#: Where the heartbeat stops: a gate that one of them holds on must not pass.
_LEVELS = (0, 1)
_BETWEEN = "rise_between_heartbeats"
#: Of the least rail: a stop's two contacts may open some ms apart.
_NEARLY = 0.9


def check(bed: Bed, log: Log, prober: Prober) -> None:
    """Ends with the supply on. Raises: BusError, BoardFault, GuardRefusal."""
    guards = bed.file.guards
    if guards.hv_enable == "absent":
        log.absent("hv_enable")
    if guards.rail_monitor == "absent":
        supply = _watch_by_node(bed, log, prober)
        if guards.hv_enable != "absent":
            _check_by_node(bed, log, prober)
        elif bed.board.stops():
            check_ramp(bed, log, prober, "ramp_before_stops")
    else:
        supply = _watch_by_monitor(bed, log, guards.rail_monitor)
        _check_by_monitor(bed, log, guards.rail_monitor)
    if guards.heartbeat == "absent":
        log.absent("heartbeat")
    if not log.stage_failed:
        stopgate.check(bed, log, supply)
    if not log.stage_failed:
        check_idle(bed, log, "idle_node_live")
    if not log.stage_failed:
        killed.check(bed, log, supply.rises)
        prober.forget_chain()


def _watch_by_monitor(bed: Bed, log: Log, monitor: RailMonitor) -> SupplyWatch:
    readings: list[Reading] = []

    def read_v() -> float:
        rail_v = bed.rail_v()
        readings.append((bed.clock.now_ns() / MS, rail_v))
        return rail_v

    def is_gone() -> bool:
        return read_v() < monitor.off_v

    def is_there() -> bool:
        return read_v() >= monitor.low_v * _NEARLY

    def rises(name: str) -> bool:
        return _check_rise(bed, log, monitor, name)

    def told() -> str:
        return f"{readings[-1][1]:.0f} V"

    return SupplyWatch(is_there, is_gone, told, monitor.fall_ms, rises, readings)


def _watch_by_node(bed: Bed, log: Log, prober: Prober) -> SupplyWatch:
    read_v = 0.0

    def is_gone() -> bool:
        nonlocal read_v
        read_v = prober.probe(bed.free[0])[1].voltage_v
        bed.wait_ms(_LOOK_EVERY_MS)
        return read_v < _gone_v(prober)

    def is_there() -> bool:
        voltage_v = prober.probe(bed.free[0])[1].voltage_v
        return voltage_v >= prober.open_v(prober.probe_ua) * _NODE_THERE

    def told() -> str:
        return f"{read_v:.2f} V at {prober.probe_ua} uA"

    def rises(name: str) -> bool:
        return _check_node_rises(bed, log, prober, name)

    return SupplyWatch(is_there, is_gone, told, _UNWATCHED_MS, rises, None)


def _gone_v(prober: Prober) -> float:
    return prober.open_v(prober.probe_ua) * _NODE_GONE


def _check_by_monitor(bed: Bed, log: Log, monitor: RailMonitor) -> None:
    if bed.file.guards.hv_enable == "absent":
        rail_v = bed.rail_v()
        is_right = monitor.low_v <= rail_v <= monitor.high_v
        log.judge("rail", is_right, f"{rail_v:.0f} V", _range(monitor), _RAIL_ADVICE)
        return
    rail_v = _settled_off(bed, monitor)
    is_off = log.judge(
        "off",
        rail_v < monitor.off_v,
        f"{rail_v:.1f} V",
        f"below {monitor.off_v} V with the supply off",
        "the supply is on although its enable is off, or the monitor's divider is another one",
    )
    if is_off and _check_rise(bed, log, monitor) and _check_enable(bed, log, monitor):
        _check_heartbeat(bed, log, monitor)


_ENABLE_ADVICE = (
    "the enable line does not switch the supply, or its store has no bleeder: cut the supply"
)
_GATE_ADVICE = (
    "the gate does not act: the monostable, its coupling, and the way from it to the supply. If it"
    " acts with the line at the other level, the line is not AC-coupled"
)
_WINDOW_ADVICE = (
    "the monostable's time is not window_ms of the board file: look at its resistor and capacitor"
)
_LATCH_ADVICE = (
    "the gate needs a latch that the enable's end clears: a program that hung and goes on would"
    " have its supply back unasked"
)
_RAIL_ADVICE = "look at the supply, its set-point and the monitor's divider"


def _range(monitor: RailMonitor) -> str:
    return f"{monitor.low_v} to {monitor.high_v} V"


def _settled_off(bed: Bed, monitor: RailMonitor) -> float:
    """What is left of a rail that may have been on before the test."""
    _wait_for(bed, lambda rail_v: rail_v < monitor.off_v, monitor.fall_ms)
    return bed.rail_v()


def _wait_for(bed: Bed, is_there: Callable[[float], bool], within_ms: float) -> float | None:
    """After how many ms the rail was where it should be; None if it was not in time."""
    begun_ns = bed.clock.now_ns()
    while not is_there(bed.rail_v()):
        if bed.clock.now_ns() - begun_ns > within_ms * MS:
            return None
        bed.watch_stops()
    return (bed.clock.now_ns() - begun_ns) / MS


def _check_rise(bed: Bed, log: Log, monitor: RailMonitor, name: str = "rise") -> bool:
    bed.supply_on()
    took_ms = _wait_for(bed, lambda rail_v: rail_v >= monitor.low_v, monitor.rise_ms)
    bed.wait_ms(monitor.rise_ms)
    rail_v = bed.rail_v()
    # An open stop takes the supply away: that is then the reason.
    bed.watch_stops()
    is_right = took_ms is not None and monitor.low_v <= rail_v <= monitor.high_v
    took = "not in time" if took_ms is None else f"after {took_ms:.0f} ms"
    return log.judge(
        name,
        is_right,
        f"{rail_v:.0f} V, in range {took}",
        f"{_range(monitor)} within {monitor.rise_ms} ms",
        _RAIL_ADVICE,
    )


def _check_enable(bed: Bed, log: Log, monitor: RailMonitor) -> bool:
    """Off by its line alone: the heartbeat goes on."""
    bed.board.supply_off()
    took_ms = _wait_falling(bed, monitor, monitor.fall_ms)
    is_good = judge_fall(
        log,
        bed.missed_ms(),
        "hv_enable",
        took_ms is not None,
        _fell(bed, monitor, took_ms),
        f"below {monitor.off_v} V within {monitor.fall_ms} ms of the enable line's end",
        _ENABLE_ADVICE,
    )
    return is_good and _check_rise(bed, log, monitor, "rise_again")


def _wait_falling(bed: Bed, monitor: RailMonitor, within_ms: float) -> float | None:
    begun_ns = bed.clock.now_ns()
    while bed.rail_v(is_beating=False) >= monitor.off_v:
        if bed.clock.now_ns() - begun_ns > within_ms * MS:
            return None
        bed.beat_now()
    return (bed.clock.now_ns() - begun_ns) / MS


def _fell(bed: Bed, monitor: RailMonitor, took_ms: float | None) -> str:
    if took_ms is None:
        return f"still {bed.rail_v(is_beating=False):.0f} V"
    return f"below {monitor.off_v} V after {took_ms:.0f} ms"


def _check_heartbeat(bed: Bed, log: Log, monitor: RailMonitor) -> None:
    heartbeat = bed.file.guards.heartbeat
    if heartbeat == "absent":
        return
    for level in _LEVELS:
        if level != _LEVELS[0] and not _rises_anew(bed, log, monitor, _BETWEEN):
            return
        _check_silence(bed, log, monitor, heartbeat, level)
        if log.stage_failed:
            return
    bed.begin_beats()
    bed.wait_ms(monitor.rise_ms)
    rail_v = bed.rail_v()
    is_good = judge_fall(
        log,
        bed.missed_ms(),
        "heartbeat_latch",
        rail_v < monitor.off_v,
        f"{rail_v:.0f} V after beating again for {monitor.rise_ms} ms",
        "it stays off until the enable line was off",
        _LATCH_ADVICE,
    )
    if is_good:
        _rises_anew(bed, log, monitor, "rise_after_heartbeat")


def _rises_anew(bed: Bed, log: Log, monitor: RailMonitor, name: str) -> bool:
    """By way of the enable line, which clears the gate's latch."""
    bed.board.supply_off()
    bed.wait_ms(1)
    return _check_rise(bed, log, monitor, name)


def _check_silence(
    bed: Bed, log: Log, monitor: RailMonitor, heartbeat: Heartbeat, level: int
) -> None:
    within_ms = heartbeat.window_ms + monitor.fall_ms
    from_v = bed.rail_v()
    bed.end_beats(level)
    missed_ms = bed.missed_ms()
    fall = watch_fall(bed, monitor, from_v, within_ms, bed.beaten_ns)
    is_good = judge_fall(
        log,
        missed_ms,
        "heartbeat",
        from_v >= monitor.low_v and fall.gone_ms is not None,
        f"from {from_v:.0f} V, {_fell(bed, monitor, fall.gone_ms)}, {_standing(level)}",
        f"from at least {monitor.low_v} V, below {monitor.off_v} V within {within_ms} ms of the"
        " last beat, the enable being on",
        _GATE_ADVICE,
    )
    if not is_good:
        return
    most_ms = reckoned_within_ms(monitor, heartbeat.window_ms)
    log.judge(
        "heartbeat_window",
        fall.is_cut_within(most_ms),
        f"the rail {fall.told_cut} without a beat, as reckoned from its fall, {_standing(level)}",
        f"{heartbeat.window_ms} ms, so reckoned to be at most {most_ms:.0f} ms",
        _WINDOW_ADVICE,
    )


def _standing(level: int) -> str:
    return f"the line standing at {level}"


def _check_by_node(bed: Bed, log: Log, prober: Prober) -> None:
    """Without a monitor: the supply is there when a probe can lift the node."""
    if not check_ramp(bed, log, prober, "off_ramp", is_supplied=False):
        return
    is_off = _judge_gone(bed, log, prober, "off", "the supply is on though its enable is off")
    is_good = (
        is_off
        and _check_node_rises(bed, log, prober, "rise")
        and _check_enable_by_node(bed, log, prober)
        and _check_node_rises(bed, log, prober, "rise_again")
    )
    if is_good:
        _check_heartbeat_by_node(bed, log, prober)


def _check_enable_by_node(bed: Bed, log: Log, prober: Prober) -> bool:
    bed.board.supply_off()
    bed.beats_when_off = True
    try:
        return _judge_gone(bed, log, prober, "hv_enable", _ENABLE_ADVICE, missed_ms=bed.missed_ms)
    finally:
        bed.beats_when_off = False


def _check_heartbeat_by_node(bed: Bed, log: Log, prober: Prober) -> None:
    """Silent until any store has run down; each look afterwards beats again, in vain."""
    if bed.file.guards.heartbeat == "absent":
        return
    for level in _LEVELS:
        if level != _LEVELS[0] and not _node_rises_anew(bed, log, prober, _BETWEEN):
            return
        if not _check_silence_by_node(bed, log, prober, level):
            return
    bed.begin_beats()
    bed.wait_ms(_UNWATCHED_RISE_MS)
    if _judge_gone(
        bed, log, prober, "heartbeat_latch", _LATCH_ADVICE, missed_ms=bed.missed_ms, within_ms=0
    ):
        _node_rises_anew(bed, log, prober, "rise_after_heartbeat")


def _check_silence_by_node(bed: Bed, log: Log, prober: Prober, level: int) -> bool:
    bed.end_beats(level)
    missed_ms = bed.missed_ms()
    bed.wait_ms(_UNWATCHED_MS, is_beating=False)
    return _judge_gone(
        bed,
        log,
        prober,
        "heartbeat",
        _GATE_ADVICE,
        missed_ms=lambda: missed_ms,
        told=f", {_standing(level)}",
    )


def _node_rises_anew(bed: Bed, log: Log, prober: Prober, name: str) -> bool:
    """As `_rises_anew`."""
    bed.board.supply_off()
    bed.wait_ms(1)
    return _check_node_rises(bed, log, prober, name)


def _check_node_rises(bed: Bed, log: Log, prober: Prober, name: str) -> bool:
    """Nothing is connected before the node was seen idle with the supply behind it."""
    bed.board.release()
    bed.supply_on()
    bed.wait_ms(_UNWATCHED_RISE_MS)
    check_idle(bed, log, f"{name}_idle")
    return not log.stage_failed and check_ramp(bed, log, prober, name)


def _judge_gone(
    bed: Bed,
    log: Log,
    prober: Prober,
    name: str,
    advice: str,
    *,
    missed_ms: Callable[[], float | None] = lambda: None,
    within_ms: int = _UNWATCHED_MS,
    told: str = "",
) -> bool:
    """A probe of the open node again and again, until it lifts it no more, or time is over.

    `missed_ms`: see `judge_fall`; asked at the end. `told`: what else is to be said of it.
    """
    bound_v = _gone_v(prober)
    read_v = 0.0

    def look() -> bool:
        nonlocal read_v
        read_v = prober.probe(bed.free[0])[1].voltage_v
        bed.wait_ms(_LOOK_EVERY_MS)
        return read_v < bound_v

    is_good = bed.wait_until(look, within_ms)
    return judge_fall(
        log,
        missed_ms(),
        name,
        is_good,
        f"{read_v:.2f} V at {prober.probe_ua} uA{told}",
        f"below {bound_v:.2f} V within {within_ms} ms",
        advice,
    )
