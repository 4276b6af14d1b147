"""The sentence about a person who feels what is not there.

Owns: the bound, and the advice. Must not know: how silent trials are presented.
"""

from __future__ import annotations

from etd.protocol.calibration import Calibration

#: More false alarms than this make thresholds doubtful.
_MOST = 0.10


def said_of_false_alarms(made: Calibration) -> str | None:
    """None where there were few, or where they are not known."""
    rate = made.false_alarm_rate
    if rate is None or made.catch_trials is None or rate <= _MOST:
        return None
    silent = f"{rate:.0%} of {made.catch_trials} silent trials, more than {_MOST:.0%}"
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
