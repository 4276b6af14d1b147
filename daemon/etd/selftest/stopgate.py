"""Stage 5: a stop that is held open takes the supply away, as measured, whatever the program does.

Owns: what is asked of the operator, and whose doing the fall is. Must not know: how the supply is
looked at (`rail_by_monitor.py`, `rail_by_node.py`).

That the line is seen to open was looked at in stage 2. Here the supply is on, the heartbeat goes on
and the enable line stays on: if the supply falls, the stop's second contact has done it. Where the
board file says that there is none (`stop_cuts_supply = false`), the program switches off as the
engine would, and that is what is measured.
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
#: Both contacts of one button, and a few looks.
_CUT_WITHIN_MS = 50


@dataclass(frozen=True, slots=True)
class SupplyWatch:
    """How this board's supply is measured."""

    is_there: Callable[[], bool]
    is_gone: Callable[[], bool]
    #: What `is_gone` read last, for people.
    told: Callable[[], str]
    #: How long it may take to fall.
    within_ms: int
    #: Switch it on, and judge that it came, under this name.
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
                _title(fixture, name), "nobody is there to hold it", "run it without --no-operator"
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
        is_gone, measured = False, f"gone before it was seen to open; {measured}"
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
        + ("enable and heartbeat going on" if cuts else "switched off by the program"),
        _GATE_ADVICE if cuts else _OFF_ADVICE,
    )
    fixture.board.supply_off()
    operator.let_go(name)
    if is_gone and _is_closed_again(fixture, log, name):
        fixture.held_stop = None
        supply.rises(f"rise_after_{name}")


_GATE_ADVICE = (
    "hold it until you are told to let go. If you did: let its second contact break the supply's"
    " own current or its enable (docs/hardware.md); a board whose stops are seen by the program"
    " alone says so: stop_cuts_supply = false"
)
_OFF_ADVICE = "hold it until you are told to let go; if you did, cut the supply by hand"


def _opens(
    fixture: Fixture, name: StopName, supply: SupplyWatch, was_there: bool
) -> tuple[bool, bool]:
    """Whether the stop was seen to open, and whether the supply was there until then.

    Of each look at the supply the stop is asked afterwards: one that was closed then is no reason.
    """
    is_there = was_there

    def look() -> bool:
        nonlocal was_there, is_there
        was_there = was_there and is_there
        is_there = supply.is_there()
        return fixture.board.stops()[name]

    return fixture.wait_until(look, _OPERATOR_WITHIN_MS), was_there


def _fall(fixture: Fixture, name: StopName, supply: SupplyWatch) -> tuple[bool, str]:
    """Whether the supply went while the stop was held, and what is to be said of it."""
    begun_ns = fixture.clock.now_ns()
    while not supply.is_gone():
        took_ms = (fixture.clock.now_ns() - begun_ns) / MS
        if not fixture.board.stops()[name]:
            return False, f"closed again after {took_ms:.0f} ms, {supply.told()}"
        if took_ms > supply.within_ms:
            return False, f"still {supply.told()} after {took_ms:.0f} ms"
        fixture.wait_ms(_LOOK_EVERY_MS)
    return True, f"{supply.told()} after {(fixture.clock.now_ns() - begun_ns) / MS:.0f} ms"


def _cut_ms(supply: SupplyWatch, opened_ns: int) -> float | None:
    """How long after the line was seen to open the supply was cut; None where that cannot
    be seen.
    """
    if not supply.readings:
        return None
    cut_ms = reckon_cut(supply.readings, supply.readings[0][1])
    return None if cut_ms is None else cut_ms - opened_ns / MS


def _is_closed_again(fixture: Fixture, log: CheckLog, name: StopName) -> bool:
    """Nothing more is said where it is: a stop that stays open is one."""
    is_closed = fixture.wait_until(lambda: not fixture.board.stops()[name], _OPERATOR_WITHIN_MS)
    if not is_closed:
        log.judge(name, False, "it stays open", "closed again", "release it")
    return is_closed
