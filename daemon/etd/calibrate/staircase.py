"""The staircase: down when it is felt, up when it is not; the threshold is the mean of the turns.

Owns: its steps and turns. Must not know: persons, daemons, reach.

Going down after one felt presentation, it converges to 50 % felt (Levitt's rules). A coarse ascent
gives the start.
"""

from __future__ import annotations

from math import exp, log

from etd.calibrate.limits import FINE, Threshold, coarse
from etd.calibrate.trial import Procedure

TURNS = 8
#: The first turns still depend on the start.
_IGNORED = 2
#: So many misses in a row at the cap count as not felt, since it was felt on the way up.
_MISSES_AT_CAP = 2


def staircase(start_ua: float) -> Procedure[Threshold]:
    """Eight turns after the coarse ascent; the geometric mean of the last six."""
    first = yield from coarse(start_ua)
    if not first.is_felt:
        return first
    requested_ua, misses, was_up = first.current_ua, 0, None
    turns: list[float] = []
    while len(turns) < TURNS:
        heard = yield requested_ua
        is_up = not heard.is_felt
        misses = misses + 1 if is_up and heard.is_at_cap and not heard.is_cap_felt else 0
        if misses == _MISSES_AT_CAP:
            return Threshold(heard.current_ua, is_felt=False)
        if was_up is not None and is_up is not was_up:
            turns.append(heard.current_ua)
        was_up = is_up
        requested_ua = heard.current_ua * (FINE if is_up else 1.0 / FINE)
    kept = turns[_IGNORED:]
    return Threshold(exp(sum(map(log, kept)) / len(kept)))
