"""The ascending method of limits: up until it is felt, three times.

Owns: where an ascent starts, its steps, and the threshold from several ascents. Must not know:
persons, daemons, reach (`trial` bounds what is requested here).

The first, coarse ascent has steps of 10 %. The next ones have steps of 5 %; each ends between the
last current that was not felt and the first that was. Their geometric mean counts; if they differ
by more than 10 %, up to four more are made and the median counts, so that one random answer or a
moving skin does not decide. An ascent that is felt at once is started again lower.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from statistics import geometric_mean, median

from etd.calibrate.reach import LEAST_UA, RISE
from etd.calibrate.trial import Procedure

FINE = 1.05
ASCENTS = 3
#: An ascent starts at this part of the current at which the one before ended.
_BACK = 0.88
#: Felt at once: start again at this part.
_DOWN = 0.7
#: Ascents that differ by more than this factor are followed by more.
_APART = 1.10
_MOST_ASCENTS = 7


@dataclass(frozen=True, slots=True)
class Threshold:
    """`is_felt` False: nothing was felt up to `current_ua`, the highest allowed current.
    `is_least`: the threshold is that or more, since nothing was felt up to there now; where
    `is_felt`, a higher current was felt before.
    """

    current_ua: float
    is_felt: bool = True
    is_least: bool = False


def coarse(start_ua: float) -> Procedure[Threshold]:
    """One ascent in steps of 10 %, started again lower if it is felt at once."""
    return (yield from _ascend(start_ua, RISE))


def limits(start_ua: float) -> Procedure[Threshold]:
    """The whole method: three ascents after the coarse one, or up to seven."""
    first = yield from coarse(start_ua)
    if not first.is_felt:
        return first
    found: list[float] = []
    at_cap = 0
    while len(found) < ASCENTS or (_are_apart(found) and len(found) < _MOST_ASCENTS):
        around_ua = median(found) if found else first.current_ua
        threshold = yield from _ascend(around_ua * _BACK, FINE)
        if not threshold.is_felt:
            return threshold
        found.append(threshold.current_ua)
        at_cap += threshold.is_least
    middle_ua = median(found) if _are_apart(found) else geometric_mean(found)
    return Threshold(middle_ua, is_least=2 * at_cap > len(found))


def _are_apart(found: list[float]) -> bool:
    return max(found) > min(found) * _APART


def _ascend(start_ua: float, step: float) -> Procedure[Threshold]:
    requested_ua = start_ua
    unfelt_ua: int | None = None
    while True:
        heard = yield requested_ua
        if not heard.is_felt:
            if heard.is_at_cap:
                return Threshold(heard.current_ua, heard.is_cap_felt, is_least=True)
            unfelt_ua = heard.current_ua
            requested_ua = max(heard.current_ua * step, heard.current_ua + 1)
        elif unfelt_ua is not None:
            return Threshold(sqrt(unfelt_ua * heard.current_ua))
        elif heard.current_ua <= LEAST_UA:
            return Threshold(heard.current_ua)
        else:
            requested_ua = heard.current_ua * _DOWN
