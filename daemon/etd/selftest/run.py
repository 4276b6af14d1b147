"""The stages in order of growing risk, and making the board safe after the last one.

Owns: the order, when to stop, and the report. Must not know: what a stage checks.
"""

from __future__ import annotations

import datetime
import sys
from collections.abc import Callable

import msgspec

from etd.selftest import (
    array,
    buses,
    machine,
    probe,
    rail,
    register,
    source,
    switches,
    table,
    timing,
)
from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog, OnCheck
from etd.selftest.prober import Prober
from etd.selftest.report import Report, unproved_of
from etd.version import __version__
from etd_hal import compiled
from etd_hal.errors import BoardFault, BusError, CannotSelect, GuardRefusal

#: In this order: name, and description for people.
STAGES = (
    ("machine", "the machine and its software"),
    ("buses", "lines, chips and stops, supply off"),
    ("register", "the chain of switches, outputs blanked"),
    ("timing", "messages at DAC code 0"),
    ("rail", "the supply, no electrode connected"),
    ("array", "imperceptible probes: what is connected"),
    ("table", "imperceptible probes: BL and POL, with the load on ground"),
    ("probe", "imperceptible probes: the source, and the load"),
    ("switches", "imperceptible probes: every electrode"),
    ("source", "strong pulses into the dummy load"),
)

_BY_HAND = "cut the supply by hand"
_SAFE = "the board is in its safe state"


def run(
    fixture: Fixture,
    date: datetime.datetime,
    on_check: OnCheck = lambda _: None,
    on_stage: Callable[[str, str], None] = lambda _name, _what: None,
) -> Report:
    """All stages, or those up to a failure; the board is made safe afterwards in any case."""
    log = CheckLog(on_check)
    prober = Prober(fixture)
    stages = _stages(fixture, log, prober)
    failed_at = len(STAGES)
    try:
        for index, (name, what) in enumerate(STAGES):
            log.stage = name
            on_stage(name, what)
            _run_stage(fixture, log, stages[name])
            if log.stage_failed:
                failed_at = index
                break
        problems = fixture.board.safe_off()
    except BaseException:
        _break_off(fixture)
        raise
    finally:
        # It cuts as it ends: what is left in the safe state then is left so.
        fixture.end_stopper()
    _skip_rest(log, failed_at)
    log.stage = "end"
    log.judge(
        "safe_state",
        not problems,
        "; ".join(problems) or "commanded, and the node is at rest",
        "outputs off, supply off, DAC at zero",
        _BY_HAND,
    )
    return _report(fixture, prober, log, date)


def _break_off(fixture: Fixture) -> None:
    """Make the board safe, from any state, and print the result."""
    problems = (*_lines_back(fixture), *fixture.board.safe_off())
    for problem in problems:
        print(f"etd selftest: NOT SAFE: {problem}: {_BY_HAND}", file=sys.stderr)  # noqa: T201
    if not problems:
        print(f"etd selftest: interrupted; {_SAFE}", file=sys.stderr)  # noqa: T201


def _lines_back(fixture: Fixture) -> tuple[str, ...]:
    """Take the lines back from the other process; why not, if that fails."""
    if not fixture.is_lent:
        return ()
    try:
        fixture.kill_test_process.step_back()
    except (BusError, OSError) as error:
        return (str(error),)
    return ()


def cut_short(fixture: Fixture, date: datetime.datetime) -> Report:
    """The report that is stored until the test ends: an earlier pass must not remain valid."""
    report = _report(fixture, Prober(fixture), CheckLog(lambda _: None), date)
    return msgspec.structs.replace(report, passed=False)


def _stages(fixture: Fixture, log: CheckLog, prober: Prober) -> dict[str, Callable[[], None]]:
    return {
        "machine": lambda: machine.check(fixture, log),
        "buses": lambda: buses.check(fixture, log),
        "register": lambda: register.check(fixture, log),
        "timing": lambda: timing.check(fixture, log),
        "rail": lambda: rail.check(fixture, log, prober),
        "array": lambda: array.check(fixture, log, prober),
        "table": lambda: table.check(fixture, log, prober),
        "probe": lambda: probe.check(fixture, log, prober),
        "switches": lambda: switches.check(fixture, log, prober),
        "source": lambda: _strong(fixture, log, prober),
    }


def _strong(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    source.check(fixture, log, prober)
    timing.check_longest(fixture, log, prober)
    machine.check_after(fixture, log)


def _run_stage(fixture: Fixture, log: CheckLog, stage: Callable[[], None]) -> None:
    """An unexpected error ends the stage, as a failed check named after its source.

    The board is made safe before progress is printed, which may be slow. Problems with that are
    reported at the end, when it is done again.
    """
    try:
        stage()
    except (BusError, BoardFault, GuardRefusal, CannotSelect) as error:
        fixture.board.safe_off()
        log.judge(_name_of(error), False, str(error), "", "correct what it reports; test again")


def _name_of(error: BusError | BoardFault | GuardRefusal | CannotSelect) -> str:
    if isinstance(error, BoardFault):
        return error.what.replace(" ", "_")
    return {BusError: "bus", GuardRefusal: "guard"}.get(type(error), "selection")


def _skip_rest(log: CheckLog, failed_at: int) -> None:
    for name, _ in STAGES[failed_at + 1 :]:
        log.stage = name
        log.skip("all", f"{STAGES[failed_at][0]} failed", "correct the failed checks first")


def _report(fixture: Fixture, prober: Prober, log: CheckLog, date: datetime.datetime) -> Report:
    load, second = fixture.options.load, fixture.options.second_load
    versions = {"etd": f"{__version__}, {compiled.runs()}", "python": sys.version.split()[0]}
    versions |= {name: version or "missing" for name, version in fixture.host.packages().items()}
    return Report(
        passed=all(check.is_good for check in log.checks),
        date=date,
        subject=fixture.subject,
        versions=versions,
        machine_facts=fixture.host.facts(),
        absent_guards=fixture.file.absent_guards,
        bound=prober.bound,
        dummy_load_ohm=None if load is None else load.resistance_ohm,
        second_load_ohm=None if second is None else second.resistance_ohm,
        load_electrodes=None if load is None else (load.first, load.second),
        not_seen=unproved_of(fixture.file),
        checks=tuple(log.checks),
    )
