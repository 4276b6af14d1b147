"""The sentence about a person who feels what is not there.

Owns: the bound, and the advice. Must not know: how silent trials are presented.
"""

from __future__ import annotations

from etd.protocol.calibration import Calibration
from etd.protocol.exponent import FittedExponent

#: More false alarms than this make thresholds doubtful.
_MOST = 0.10


def said_of_false_alarms(made: Calibration) -> str | None:
    """None where there were few, or where they are not known."""
    silent = _too_many(made)
    if silent is None:
        return None
    if made.method == "equalize":
        return (
            f"{made.participant} called silence as strong as the reference in {silent}: the levels"
            " may be too low; explain the task again (what is not felt is weaker), and calibrate"
            " again"
        )
    return (
        f"{made.participant} felt {silent}: the thresholds may be too low; explain the task again"
        " (n when nothing is felt), and calibrate again"
    )


def said_of_false_alarms_of_fit(made: Calibration) -> str | None:
    """The same of the states in which its exponent was measured."""
    silent = None if made.exponent is None else _too_many(made.exponent)
    if silent is None:
        return None
    return (
        f"{made.participant} felt {silent}, while k was measured: thresholds may be too low, and k"
        " be wrong; explain the task again (n when nothing is felt), and measure it again"
        " (etd calibrate CODE --fit)"
    )


def _too_many(asked: Calibration | FittedExponent) -> str | None:
    rate, silent = asked.false_alarm_rate, asked.catch_trials
    if rate is None or silent is None or rate <= _MOST:
        return None
    return f"{rate:.0%} of {silent} silent trials, more than {_MOST:.0%}"
