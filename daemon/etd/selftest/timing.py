"""Stage 4, DAC at code 0: the duration of messages on this machine, and its spread.

Owns: the names of the checks. Must not know: how constants are measured (`etd_hal.timing`).
"""

from __future__ import annotations

from etd.safety.maxima import PC_PER_NC, maxima_of
from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd_hal.errors import BoardFault
from etd_hal.timing import constants

_PREFIX = "timing calibration, "
_ADVICE = (
    "the machine file is for another machine, or another program uses the core: check the model,"
    " throttling, and other programs"
)


def check(fixture: Fixture, log: CheckLog) -> None:
    """Raises: BusError, GuardRefusal."""
    machine = fixture.loaded.machine
    try:
        found = fixture.board.calibrate()
    except BoardFault as fault:
        name = _name_of(fault.what.removeprefix(_PREFIX))
        log.judge(name, False, fault.measured, fault.expected, _ADVICE)
        return
    for what, found_us, bounds in constants(found, machine):
        expected = f"{bounds.low} to {bounds.high} us"
        log.judge(_name_of(what), True, f"{found_us:.2f} us", expected)


def _name_of(constant: str) -> str:
    return constant.replace(" ", "_")


def check_longest(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """After all pulses: the longest excess of a message over its plan, for each kind.

    An excess above `halt_excess_us` has ended the test before.
    """
    listed = ", ".join(f"{what} {over_us:.0f} us" for what, over_us in prober.over_us.items())
    most_us, why = _most_over_us(fixture)
    log.judge(
        "longest_message",
        max(prober.over_us.values()) <= most_us,
        f"over the plan: {listed}",
        f"at most {most_us:.0f} us: {why}",
        "another program interrupts pulses, and no one_shot ends them: check isolcpus, real-time"
        " scheduling, and other programs",
    )


def _most_over_us(fixture: Fixture) -> tuple[float, str]:
    """The most that a message may exceed its plan, and the reason.

    The strongest current allowed for a person flows during the excess. Together with the body
    site's largest charge it must not exceed the board file's charge, unless a one-shot ends the
    pulse. The spread allowed by the calibration is always allowed.
    """
    machine, one_shot = fixture.loaded.machine, fixture.file.guards.one_shot
    if one_shot != "absent":
        return machine.halt_excess_us, f"the one-shot ends a pulse after {one_shot.on_us} us"
    maxima = maxima_of(fixture.file, fixture.loaded.body_site)
    most_nc = fixture.file.maxima.charge_nc
    spare_us = (most_nc * PC_PER_NC - maxima.charge_pc) / maxima.current_ua
    most_us = min(machine.halt_excess_us, max(machine.spread_us, spare_us))
    why = f"longer at {maxima.current_ua} uA in addition to {maxima.charge_pc // PC_PER_NC} nC"
    return most_us, f"{why} would exceed the board's {most_nc} nC"
