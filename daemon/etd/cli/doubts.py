"""What is to be doubted of a calibration, as sentences: at its end, and whenever it is shown.

Owns: the sentences about drift and about electrodes that are not felt within their caps, and the
order of all. Must not know: how silent trials are presented, how a calibration is made.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping

from etd.calibrate.course import MOST_DRIFT, is_rest_due
from etd.cli.false_alarms import said_of_false_alarms, said_of_false_alarms_of_fit
from etd.protocol.calibration import Calibration, ElectrodeLimits


def doubts_of(made: Calibration, today: datetime.date | None = None) -> list[str]:
    """None where nothing is known against it. `today`: where it was made before."""
    found = (
        _of_date(made, today),
        said_of_false_alarms(made),
        said_of_false_alarms_of_fit(made),
        _of_drift(made),
        said_of_caps(dict(enumerate(made.electrode))),
    )
    return [sentence for sentence in found if sentence is not None]


def drift_in_words(drift: float, *, is_least: bool) -> str:
    """`risen by 42%`; by at least so much, where it was not felt any more up to its cap."""
    if is_least:
        return f"risen by at least {max(drift, 0.0):.0%} (it was not felt up to its cap)"
    return f"{'risen' if drift > 0 else 'fallen'} by {abs(drift):.0%}"


def _of_date(made: Calibration, today: datetime.date | None) -> str | None:
    if today is None or made.date <= today:
        return None
    return f"it is of {made.date}, and this computer has {today}: one of the two is wrong"


def _of_drift(made: Calibration) -> str | None:
    is_least = made.is_drift_least is True
    if made.drift is None or not is_rest_due(made.drift, is_least=is_least):
        return None
    bound = "" if is_least else f", more than {MOST_DRIFT:.0%}"
    return (
        f"the first electrode's threshold had {drift_in_words(made.drift, is_least=is_least)} when"
        f" it was last asked again{bound}: those of the others may be off by as much; let"
        f" {made.participant} rest, and calibrate again"
    )


def said_of_caps(each: Mapping[int, ElectrodeLimits]) -> str | None:
    """Of those that have a `felt_from_ua`; None where none has."""
    found = [
        f"{electrode} (felt from {limits.felt_from_ua} uA on, its cap is {limits.cap_ua} uA)"
        for electrode, limits in each.items()
        if limits.felt_from_ua is not None
    ]
    if not found:
        return None
    return (
        "not felt within its cap, which was taken down where something was too strong: electrode"
        f" {', '.join(found)}"
    )
