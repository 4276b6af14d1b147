"""Stage 4, DAC at code 0: how long messages take on this machine, and how much that spreads.

Owns: the names of the constants. Must not know: how they are found (`etd_hal.timing`).
"""

from __future__ import annotations

from etd.selftest.bed import Bed
from etd.selftest.log import Log
from etd.selftest.prober import Prober
from etd_hal.errors import BoardFault

_PREFIX = "timing calibration, "
_ADVICE = (
    "the machine file is for another machine, or something else takes the core: look at the model,"
    " at throttling, and at what else runs"
)


def check(bed: Bed, log: Log) -> None:
    """Raises: BusError, GuardRefusal."""
    machine = bed.loaded.machine
    try:
        found = bed.board.calibrate()
    except BoardFault as fault:
        name = fault.what.removeprefix(_PREFIX).replace(" ", "_")
        log.judge(name, False, fault.measured, fault.expected, _ADVICE)
        return
    for name, found_us, low_us, high_us in (
        ("one_word", found.word_us, machine.word_us.low, machine.word_us.high),
        (
            "overhead_of_a_delay",
            found.delay_extra_us,
            machine.delay_extra_us.low,
            machine.delay_extra_us.high,
        ),
        (
            "overhead_of_a_message",
            found.message_us,
            machine.message_us.low,
            machine.message_us.high,
        ),
        ("spread_of_a_message", found.spread_us, 0.0, machine.spread_us),
    ):
        log.judge(name, True, f"{found_us:.2f} us", f"{low_us} to {high_us} us")


def check_longest(bed: Bed, log: Log, prober: Prober) -> None:
    """After all pulses: how much longer than planned the kernel made the longest of each kind.

    One above the bound has ended the test before. Nothing that a machine file says makes another
    bound for strong ones; who reads the report sees what there is of it.
    """
    told = ", ".join(f"{what} {over_us:.0f} us" for what, over_us in prober.over_us.items())
    most_us = bed.loaded.machine.halt_excess_us
    log.judge("longest_message", True, f"over the plan: {told}", f"at most {most_us:.0f} us")
