"""The stages in order of growing risk, and the way to the safe state after the last one.

Owns: the order, when to stop, and the report. Must not know: what a stage looks at.
"""

from __future__ import annotations

import datetime
import sys
from collections.abc import Callable

import msgspec

from etd.selftest import buses, machine, probe, rail, register, source, switches, timing
from etd.selftest.bed import Bed
from etd.selftest.log import Log, OnCheck
from etd.selftest.prober import Prober
from etd.selftest_report import Report, not_seen_of
from etd.version import __version__
from etd_hal.errors import BoardFault, BusError, CannotSelect, GuardRefusal

#: In this order; the second of each tells people what comes.
STAGES = (
    ("machine", "the machine and its software"),
    ("buses", "lines, chips and stops, supply off"),
    ("register", "the chain of switches, blanked"),
    ("timing", "messages at DAC code 0"),
    ("rail", "the supply, no electrode connected"),
    ("probe", "imperceptible probes: what is connected"),
    ("switches", "imperceptible probes: every electrode"),
    ("source", "strong pulses into the dummy load"),
)

_BY_HAND = "cut the supply by hand"
_SAFE = "the board is in its safe state"


def run(
    bed: Bed,
    date: datetime.datetime,
    on_check: OnCheck = lambda _: None,
    on_stage: Callable[[str, str], None] = lambda _name, _what: None,
) -> Report:
    """All stages, or as many as may be; the board is safe afterwards whatever happens."""
    log = Log(on_check)
    prober = Prober(bed)
    stages = _stages(bed, log, prober)
    failed_at = len(STAGES)
    try:
        for index, (name, what) in enumerate(STAGES):
            log.stage = name
            on_stage(name, what)
            _run_stage(bed, log, stages[name])
            if log.stage_failed:
                failed_at = index
                break
        problems = bed.board.safe_off()
    except BaseException:
        _break_off(bed)
        raise
    _skip_rest(log, failed_at)
    log.stage = "end"
    log.judge(
        "safe_state",
        not problems,
        "; ".join(problems) or "told, and the node is at rest",
        "outputs off, supply off, DAC at zero",
        _BY_HAND,
    )
    return _report(bed, prober, log, date)


def _break_off(bed: Bed) -> None:
    """The way to the safe state, from anywhere; told either way."""
    problems = (*_lines_back(bed), *bed.board.safe_off())
    for problem in problems:
        print(f"etd selftest: NOT SAFE: {problem}: {_BY_HAND}", file=sys.stderr)  # noqa: T201
    if not problems:
        print(f"etd selftest: broken off; {_SAFE}", file=sys.stderr)  # noqa: T201


def _lines_back(bed: Bed) -> tuple[str, ...]:
    """From another process, whose end was broken off as well; why not, if it cannot be."""
    if not bed.is_lent:
        return ()
    try:
        bed.understudy.step_back()
    except (BusError, OSError) as error:
        return (str(error),)
    return ()


def cut_short(bed: Bed, date: datetime.datetime) -> Report:
    """What is kept until the test has come to its end: a pass from before must not outlive it."""
    report = _report(bed, Prober(bed), Log(lambda _: None), date)
    return msgspec.structs.replace(report, passed=False)


def _stages(bed: Bed, log: Log, prober: Prober) -> dict[str, Callable[[], None]]:
    return {
        "machine": lambda: machine.check(bed, log),
        "buses": lambda: buses.check(bed, log),
        "register": lambda: register.check(bed, log),
        "timing": lambda: timing.check(bed, log),
        "rail": lambda: rail.check(bed, log, prober),
        "probe": lambda: probe.check(bed, log, prober),
        "switches": lambda: switches.check(bed, log, prober),
        "source": lambda: _strong(bed, log, prober),
    }


def _strong(bed: Bed, log: Log, prober: Prober) -> None:
    source.check(bed, log, prober)
    timing.check_longest(bed, log, prober)
    machine.check_after(bed, log)


def _run_stage(bed: Bed, log: Log, stage: Callable[[], None]) -> None:
    """An error that a stage does not expect ends it, under the name of what raised it.

    The board is safe before it is told: whoever reads the progress may be slow. What goes wrong
    with that is told at the end, when it is done again.
    """
    try:
        stage()
    except (BusError, BoardFault, GuardRefusal, CannotSelect) as error:
        bed.board.safe_off()
        log.judge(_name_of(error), False, str(error), "", "see what it says; then begin again")


def _name_of(error: BusError | BoardFault | GuardRefusal | CannotSelect) -> str:
    if isinstance(error, BoardFault):
        return error.what.replace(" ", "_")
    return {BusError: "bus", GuardRefusal: "guard"}.get(type(error), "selection")


def _skip_rest(log: Log, failed_at: int) -> None:
    for name, _ in STAGES[failed_at + 1 :]:
        log.stage = name
        log.skip("all", f"{STAGES[failed_at][0]} failed", "put that right first")


def _report(bed: Bed, prober: Prober, log: Log, date: datetime.datetime) -> Report:
    load, second = bed.asked.load, bed.asked.second_load
    versions = {"etd": __version__, "python": sys.version.split()[0]}
    versions |= {name: version or "missing" for name, version in bed.host.packages().items()}
    return Report(
        passed=all(check.is_good for check in log.checks),
        date=date,
        subject=bed.subject,
        versions=versions,
        machine_facts=bed.host.facts(),
        absent_guards=bed.file.absent_guards,
        bound=prober.bound,
        dummy_load_ohm=None if load is None else load.resistance_ohm,
        second_load_ohm=None if second is None else second.resistance_ohm,
        load_electrodes=None if load is None else (load.first, load.second),
        not_seen=not_seen_of(bed.file),
        checks=tuple(log.checks),
    )
