"""Stage 5: a stop that is held open cuts the supply, independently of the program.

Owns: the instructions to the operator, and what has caused the fall. Must not know: how the supply
is measured (`rail_by_monitor.py`, `rail_by_node.py`).

Stage 2 has checked that the line opens. Here the supply is on, heartbeat and enable line continue:
if the supply falls, the stop's second contact has cut it. If the board file says that there is none
(`stop_cuts_supply = false`), the program switches the supply off as the engine would, and that is
measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from etd.selftest.fall import Reading, judge_fall, reckon_cut
from etd.selftest.fixture import MS, Fixture
from etd.selftest.log import CheckLog
from etd_hal.bench import Operator, StopName

_STOPS: tuple[StopName, ...] = ("emergency_stop", "wearer_stop")
_OPERATOR_WITHIN_MS = 20_000
_LOOK_EVERY_MS = 10
#: Between the two contacts of a button, and a few readings.
_CUT_WITHIN_MS = 50


@dataclass(frozen=True, slots=True)
class SupplyWatch:
    """How this board's supply is measured."""

    is_there: Callable[[], bool]
    is_gone: Callable[[], bool]
    #: The last reading of `is_gone`, for reports.
    reading: Callable[[], str]
    #: How long it may take to fall.
    within_ms: int
    #: Switches it on and checks it, under this name.
    rises: Callable[[str], bool]
    #: All readings so far, by the clock; None where the rail is not monitored.
    readings: list[Reading] | None


def check(fixture: Fixture, log: CheckLog, supply: SupplyWatch) -> None:
    """Begins and ends with the supply on. Raises: BusError, BoardFault, GuardRefusal."""
    for name in _STOPS:
        if name not in fixture.board.stops():
            continue
        if fixture.operator is None:
            log.skip(
                _title(fixture, name), "no operator to hold it", "run it without --no-operator"
            )
            continue
        try:
            _check_one(fixture, log, fixture.operator, name, supply)
        finally:
            fixture.held_stop = None
        if log.stage_failed:
            return


def _title(fixture: Fixture, name: StopName) -> str:
    return f"{name}_gate" if fixture.file.guards.stop_cuts_supply else f"{name}_off"


def _check_one(
    fixture: Fixture, log: CheckLog, operator: Operator, name: StopName, supply: SupplyWatch
) -> None:
    cuts = fixture.file.guards.stop_cuts_supply
    if not cuts:
        log.absent(f"{name}_gate")
    fixture.held_stop = name
    if supply.readings is not None:
        supply.readings.clear()
    was_there = supply.is_there()
    operator.hold(name)
    is_open, was_there = _opens(fixture, name, supply, was_there)
    opened_ns = fixture.clock.now_ns()
    missed_ms = fixture.beats.missed_ms()
    if is_open and not cuts:
        fixture.board.supply_off()
    is_gone, measured = _fall(fixture, name, supply) if is_open else (False, "not seen to open")
    if is_open and not was_there:
        is_gone, measured = False, f"the supply fell before the stop opened; {measured}"
    late_ms = _cut_ms(supply, opened_ns) if is_gone and cuts else None
    if late_ms is not None:
        is_gone = late_ms <= _CUT_WITHIN_MS
        measured = f"cut {late_ms:.0f} ms after the line, {measured}"
    is_gone = judge_fall(
        log,
        fixture.beats.missed_ms() if cuts else missed_ms,
        _title(fixture, name),
        is_gone,
        measured,
        ("" if not cuts or supply.readings is None else f"cut within {_CUT_WITHIN_MS} ms and ")
        + f"gone within {supply.within_ms} ms of the opening, "
        + ("with enable and heartbeat on" if cuts else "switched off by the program"),
        _GATE_ADVICE if cuts else _OFF_ADVICE,
    )
    fixture.board.supply_off()
    operator.let_go(name)
    if is_gone and _is_closed_again(fixture, log, name):
        fixture.held_stop = None
        supply.rises(f"rise_after_{name}")


_GATE_ADVICE = (
    "hold it until asked to release it. If you did: wire its second contact to break the supply's"
    " current or its enable (docs/hardware.md); for a board whose stops only reach the program, set"
    " stop_cuts_supply = false in the board file"
)
_OFF_ADVICE = "hold it until asked to release it; if you did, cut the supply by hand"


def _opens(
    fixture: Fixture, name: StopName, supply: SupplyWatch, was_there: bool
) -> tuple[bool, bool]:
    """Whether the stop opened, and whether the supply was on until then.

    The stop is read after the supply: if it is still closed, it did not cause the supply's fall.
    """
    is_there = was_there

    def look() -> bool:
        nonlocal was_there, is_there
        was_there = was_there and is_there
        is_there = supply.is_there()
        return fixture.board.stops()[name]

    return fixture.wait_until(look, _OPERATOR_WITHIN_MS), was_there


def _fall(fixture: Fixture, name: StopName, supply: SupplyWatch) -> tuple[bool, str]:
    """Whether the supply fell while the stop was held, and the description."""
    begun_ns = fixture.clock.now_ns()
    while not supply.is_gone():
        took_ms = (fixture.clock.now_ns() - begun_ns) / MS
        if not fixture.board.stops()[name]:
            return False, f"closed again after {took_ms:.0f} ms, {supply.reading()}"
        if took_ms > supply.within_ms:
            return False, f"still {supply.reading()} after {took_ms:.0f} ms"
        fixture.wait_ms(_LOOK_EVERY_MS)
    return True, f"{supply.reading()} after {(fixture.clock.now_ns() - begun_ns) / MS:.0f} ms"


def _cut_ms(supply: SupplyWatch, opened_ns: int) -> float | None:
    """The time from the opening of the line to the cut; None if it cannot be measured."""
    if not supply.readings:
        return None
    cut_ms = reckon_cut(supply.readings, supply.readings[0][1])
    return None if cut_ms is None else cut_ms - opened_ns / MS


def _is_closed_again(fixture: Fixture, log: CheckLog, name: StopName) -> bool:
    """A stop that stays open fails."""
    is_closed = fixture.wait_until(lambda: not fixture.board.stops()[name], _OPERATOR_WITHIN_MS)
    if not is_closed:
        log.judge(name, False, "it stays open", "closed again", "release it")
    return is_closed
