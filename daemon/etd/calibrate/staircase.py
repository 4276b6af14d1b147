"""The staircase: down when it is felt, up when it is not; the threshold is estimated from all that.

Owns: its steps, and when it ends. Must not know: persons, daemons, reach, how a threshold is
estimated (estimate).

Going down after one felt presentation, it stays about the current that is felt half of the time
(Levitt's rules). A mean of its turns would count each false alarm on the way up as two turns, so it
ends when the estimate is narrow, and the estimate is the result.
"""

from __future__ import annotations

from etd.calibrate.estimate import ThresholdEstimate
from etd.calibrate.limits import FINE, Threshold
from etd.calibrate.reach import LEAST_UA, RISE
from etd.calibrate.trial import Procedure

#: It ends when the standard deviation is below this (logarithm), after this many presentations.
_KNOWN = 0.065
_LEAST = 10
#: Steps are 10 % until it is known this well, then 5 %. After many presentations it suffices.
_NEAR = 0.10
_MANY = 60
#: So likely above the cap, after so many misses there, nothing more is found below it.
_ABOVE_CAP = 0.9
_MISSES_AT_CAP = 3
#: At the least, of both kinds of answer: where everything is felt, down to the least current,
#: nothing is known.
_OF_EACH = 2


def staircase(start_ua: float) -> Procedure[Threshold]:
    """From below. Where nothing settles it does not end by itself: `trial` bounds that."""
    estimate = ThresholdEstimate()
    requested_ua, felt, missed, missed_at_cap = start_ua, 0, 0, 0
    while True:
        heard = yield requested_ua
        estimate.update(heard.current_ua, is_felt=heard.is_felt)
        felt, missed = felt + heard.is_felt, missed + (not heard.is_felt)
        missed_at_cap += heard.is_at_cap and not heard.is_felt
        if (
            missed_at_cap >= _MISSES_AT_CAP
            and heard.is_at_cap
            and estimate.above(heard.current_ua) > _ABOVE_CAP
        ):
            return Threshold(heard.current_ua, heard.is_cap_felt, is_least=True)
        spread, trials = estimate.spread, felt + missed
        is_known = spread < (_KNOWN if trials < _MANY else _NEAR)
        if is_known and trials >= _LEAST and min(felt, missed) >= _OF_EACH:
            found_ua = estimate.threshold_ua
            if found_ua > LEAST_UA:
                return Threshold(found_ua)
        step = RISE if spread > _NEAR else FINE
        requested_ua = heard.current_ua / step if heard.is_felt else heard.current_ua * step
