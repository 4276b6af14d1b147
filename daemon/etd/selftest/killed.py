"""Stage 5: the process that drives the board is killed; pulls and gates must make the board safe.

Owns: what the lines and the supply must do then, and within which time. Must not know: the process
(`etd_hal.bench.KillTestProcess`).

No program can make a board safe right after its own `kill -9`: `etd safe` takes most of a second to
start, and what is beside the engine may be killed too. So the board must do it. The kernel releases
the lines, and their pulls set them to safe levels; where pins stay driven, or a process is stopped
but not killed, the heartbeat's monostable cuts the supply.
"""

from __future__ import annotations

from etd.selftest.fall import reckoned_within_ms, watch_fall
from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
from etd_hal.boardfile import RailMonitor

#: The time that a fault may last; see docs/hardware.md, Guards.
_SAFE_WITHIN_MS = 20.0
_UP_EVERY_MS = 20


def check(fixture: Fixture, log: CheckLog) -> None:
    """Begins with the supply on, and ends with the board safe. Raises: BusError, BoardFault,
    GuardRefusal.
    """
    monitor = fixture.file.guards.rail_monitor
    fixture.is_lent = True
    try:
        fixture.kill_test_process.take_over()
        if monitor == "absent":
            fixture.wait_ms(_UP_EVERY_MS, is_beating=False)
            _check_lines(fixture, log, fixture.kill_test_process.kill())
        else:
            _check_watched(fixture, log, monitor)
    finally:
        fixture.kill_test_process.step_back()
        fixture.is_lent = False
        problems = fixture.board.safe_off()
    if problems:
        log.judge("killed_safe_state", False, "; ".join(problems), "reached", _NOT_SAFE_ADVICE)


_NOT_SAFE_ADVICE = "cut the supply by hand; check the first item listed"
_ADVICE = (
    "fit the pull resistor that this line needs (docs/bring-up.md, Wires and pulls): it sets the"
    " safe level while no program drives the line"
)


def _check_watched(fixture: Fixture, log: CheckLog, monitor: RailMonitor) -> None:
    """The other process raises the rail and beats for it, then it is killed."""
    if not _comes_up(fixture, log, monitor):
        return
    from_v = fixture.rail_v(is_beating=False)
    killed_ns = fixture.clock.now_ns()
    took_ms = fixture.kill_test_process.kill()
    guards = fixture.file.guards
    if guards.hv_enable == "absent" and guards.heartbeat == "absent":
        _check_lines(fixture, log, took_ms)
        return
    guard_ms = max(
        _SAFE_WITHIN_MS, 0.0 if guards.heartbeat == "absent" else float(guards.heartbeat.window_ms)
    )
    fall = watch_fall(fixture, monitor, from_v, guard_ms + monitor.fall_ms, killed_ns)
    _check_lines(fixture, log, took_ms)
    within_ms = reckoned_within_ms(monitor, guard_ms)
    gone = "stays" if fall.gone_ms is None else f"gone after {fall.gone_ms:.0f} ms"
    log.judge(
        "killed_supply",
        fall.is_cut_within(within_ms) and fall.gone_ms is not None,
        f"{fall.cut_text}, {gone}",
        f"cut within {guard_ms:.0f} ms of the kill (estimate at most {within_ms:.0f} ms), and below"
        f" {monitor.off_v} V within {monitor.fall_ms} ms",
        "the enable's pull and the heartbeat's gate must each cut the supply without any program",
    )


def _comes_up(fixture: Fixture, log: CheckLog, monitor: RailMonitor) -> bool:
    rail_v = 0.0

    def is_up() -> bool:
        nonlocal rail_v
        rail_v = fixture.rail_v(is_beating=False)
        return rail_v >= monitor.low_v

    is_there = fixture.wait_until(is_up, monitor.rise_ms, is_beating=False)
    fixture.wait_ms(monitor.rise_ms, is_beating=False)
    rail_v = fixture.rail_v(is_beating=False)
    if is_there and rail_v >= monitor.low_v:
        return True
    return log.judge(
        "killed_rise",
        False,
        f"{rail_v:.0f} V while another process held the board",
        f"at least {monitor.low_v} V",
        "other programs on this machine delayed its heartbeat: end them",
    )


def _check_lines(fixture: Fixture, log: CheckLog, took_ms: float) -> None:
    """The lines' levels while no process drives them."""
    levels = fixture.kill_test_process.levels()
    wanted = _safe_levels(fixture)
    wrong = [f"{name} {levels[line]}" for name, line, level in wanted if levels[line] != level]
    listed = ", ".join(f"{name} {level}" for name, _, level in wanted)
    is_in_time = took_ms <= _SAFE_WITHIN_MS or fixture.file.guards.heartbeat != "absent"
    log.judge(
        "killed_lines",
        not wrong and is_in_time,
        f"{', '.join(wrong) or listed}; released after {took_ms:.1f} ms",
        f"{listed}, by the pulls alone, within {_SAFE_WITHIN_MS:.0f} ms of the kill",
        _ADVICE if wrong else "end other programs; fit a heartbeat gate (docs/hardware.md)",
    )


def _safe_levels(fixture: Fixture) -> list[tuple[str, int, int]]:
    """(function, line, level) wherever a level is required while no process drives the line."""
    lines, safe_levels = fixture.file.switch.lines, fixture.file.switch.safe_levels
    found = [(name, getattr(lines, name), level) for name, level in safe_levels]
    found += [("LE", lines.LE, 0), ("CLK", lines.CLK, 0)]
    enable = fixture.file.guards.hv_enable
    if enable != "absent":
        found.append(("HV ENABLE", enable.line, 1 - enable.on))
    return found
