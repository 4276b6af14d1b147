"""Equal strength: one electrode's current until it feels as strong as the reference.

Owns: the ascent to it and the turns around it. Must not know: persons, daemons, reach, which
electrode is the reference (`trial.run`'s `present` shows that one first).
"""

from __future__ import annotations

from math import exp, log

from etd.calibrate.answers import Answer
from etd.calibrate.limits import FINE
from etd.calibrate.reach import RISE
from etd.calibrate.trial import Procedure

#: It ends after so many turns, or so many answers `same`: fewer make a poor mean if the skin moves.
_TURNS = 6
_SAME = 4
#: After an answer `same` or a turn, so many answers `weaker` at the cap end it.
_WEAKER_AT_CAP = 2


def lead_up(from_ua: float, to_ua: float) -> Procedure[Answer]:
    """In steps of 10 % up to a current that was accepted earlier: the last answer. `too_strong`
    ends it before; `not_felt` was answered twice there.
    """
    requested_ua, missed = from_ua, 0
    while True:
        heard = yield min(requested_ua, to_ua)
        is_there = heard.current_ua >= round(to_ua)
        missed = missed + 1 if is_there and not heard.is_felt else 0
        if heard.answer == "too_strong" or (is_there and missed in (0, 2)):
            return heard.answer
        requested_ua = heard.current_ua * RISE


def equalize(start_ua: float) -> Procedure[int]:
    """Steps of 10 % up while it is weaker, then of 5 %. Returns the current, in uA, that is as
    strong as the reference, or the highest allowed one if that is weaker.
    """
    places: list[int] = []
    same = turns = weaker_at_cap = 0
    requested_ua, was_up, step = start_ua, True, RISE
    while turns < _TURNS and same < _SAME:
        heard = yield requested_ua
        is_up = heard.answer == "weaker"
        weaker_at_cap += is_up and heard.is_at_cap
        if weaker_at_cap == (_WEAKER_AT_CAP if places else 1):
            return heard.current_ua
        if heard.answer == "same":
            same += 1
            places.append(heard.current_ua)
            # Once from above, once from below: the edges of `same` lie on both sides.
            requested_ua = heard.current_ua * (FINE if same % 2 else 1.0 / FINE)
            continue
        if is_up is not was_up:
            turns, step = turns + 1, FINE
            places.append(heard.current_ua)
        was_up = is_up
        requested_ua = heard.current_ua * (step if is_up else 1.0 / FINE)
    return round(exp(sum(map(log, places)) / len(places)))
