"""The ascent from the threshold to the comfortable level, and a little above it for the cap.

Owns: the steps, and when to stop. Must not know: persons, daemons, reach.

Steps are 5 %: on some electrodes pain is near the threshold. The cap is the highest current that
was presented and accepted, never an untried one. After `comfortable` the same current is presented
once more, and counts when it is called so again: a key slips, and a level is what is felt. Then the
ascent continues by at most 20 % (what stabilizers may need above a level of 1), and ends at the
first `too_strong`.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.calibrate.limits import FINE
from etd.calibrate.reach import LEAST_UA, RISE
from etd.calibrate.trial import Procedure

#: The cap is sought up to this multiple of the comfortable level.
HEADROOM = 1.2


@dataclass(frozen=True, slots=True)
class Comfortable:
    """In uA; `cap_ua` was presented and accepted. `is_felt` False: nothing up to there was felt in
    the ascent.
    """

    comfortable_ua: int
    cap_ua: int
    is_felt: bool = True


def comfortable(threshold_ua: int, known_ua: float = 0.0) -> Procedure[Comfortable]:
    """Steps are 10 % up to `known_ua`: the comfortable level of an earlier calibration is higher.

    Ends at the headroom, at the reach's cap, or before what was too strong. If nothing was called
    comfortable, the strongest accepted current is both figures.
    """
    requested_ua: float = threshold_ua
    chosen_ua: int | None = None
    #: Called comfortable once.
    once_ua: int | None = None
    accepted_ua = 0
    is_felt = False
    while True:
        heard = yield requested_ua
        if heard.answer == "too_strong":
            if 0 < accepted_ua < heard.current_ua:
                break
            # Not even what was accepted before: what is left may not be felt any more.
            accepted_ua, chosen_ua, once_ua, is_felt = 0, None, None, False
            if heard.current_ua <= LEAST_UA:
                break
            requested_ua = heard.current_ua / FINE
            continue
        accepted_ua = max(accepted_ua, heard.current_ua)
        is_felt = is_felt or heard.is_felt
        if heard.answer == "comfortable" and chosen_ua is None:
            if heard.current_ua != once_ua:
                requested_ua = once_ua = heard.current_ua
                continue
            chosen_ua = once_ua
        enough_ua = None if chosen_ua is None else round(chosen_ua * HEADROOM)
        if heard.is_at_cap or (enough_ua is not None and accepted_ua >= enough_ua):
            break
        requested_ua = min(heard.current_ua * RISE, max(known_ua, heard.current_ua * FINE))
        if enough_ua is not None:
            requested_ua = min(requested_ua, enough_ua)
    return Comfortable(chosen_ua or accepted_ua, accepted_ua, is_felt)
