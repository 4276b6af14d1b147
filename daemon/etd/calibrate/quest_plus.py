"""QUEST+ (Watson 2017), by the library questplus: each presentation where it is most informative.

Owns: the grids (the prior), when to end, and the current that is felt half of the time by the
fitted Weibull function. Must not know: persons, daemons, reach; a request above the reach is
presented at its edge, and QUEST+ is updated with that current.

questplus brings scipy, pandas and xarray (250 MB), so it is an extra of its own.
"""

from __future__ import annotations

from copy import deepcopy
from functools import cache
from math import log, log10, sqrt
from typing import Any

from etd.calibrate.limits import Threshold, coarse
from etd.calibrate.trial import Procedure
from etd.protocol.errors import PackageMissing

#: Currents, and thresholds to choose from, relative to what the coarse ascent found.
_STEP = 1.025
_STEPS = 16
#: Of a Weibull function over log10 of the current: felt from a little to nearly always within 60,
#: 30 or 15 % of the threshold.
_SLOPES = (8.0, 16.0, 32.0)
#: False alarms and misses: one presentation in fifty each.
_GUESS = _LAPSE = 0.02
_LEAST_TRIALS = 10
_MOST_TRIALS = 24
#: It ends when the threshold is known as well as this (standard deviation, log10: 2.5 %).
_KNOWN = log10(1.025)


def ready_questplus() -> None:
    """Import questplus and make the initial state. The first call takes a second or more: call it
    before a lease is opened.

    Raises: PackageMissing, with what to install.
    """
    try:
        import questplus  # noqa: F401
    except ModuleNotFoundError:
        otherwise = " (every other --method does without)"
        raise PackageMissing("questplus", "quest-plus", otherwise) from None
    _fresh()


def quest_plus(start_ua: float) -> Procedure[Threshold]:
    """Around a coarse ascent; again if it ends at the grid's edge. Raises: PackageMissing."""
    ready_questplus()
    first = yield from coarse(start_ua)
    while first.is_felt:
        found = yield from _around(first.current_ua)
        if not found.is_felt or not _is_at_edge(found.current_ua / first.current_ua):
            return found
        first = yield from coarse(found.current_ua * 0.7)
    return first


def _around(center_ua: float) -> Procedure[Threshold]:
    """Not felt if the final estimate is above the cap: a single miss there means little."""
    quest = deepcopy(_fresh())
    most_ua: int | None = None
    for trial in range(_MOST_TRIALS):
        if trial >= _LEAST_TRIALS and _spread(quest) < _KNOWN:
            break
        heard = yield center_ua * 10 ** float(quest.next_intensity)
        if heard.is_at_cap and not heard.is_cap_felt:
            most_ua = heard.current_ua
        heard_at = log10(heard.current_ua / center_ua)
        place = min(_grid(), key=lambda value: abs(value - heard_at))
        quest.update(intensity=place, response="Yes" if heard.is_felt else "No")
    found_ua = center_ua * 10 ** _half_felt(quest.param_estimate)
    if most_ua is not None and found_ua > most_ua:
        return Threshold(most_ua, is_felt=False, is_least=True)
    return Threshold(found_ua)


def _half_felt(estimate: dict[str, float]) -> float:
    """Where the function of these parameters is 1/2, in log10 over the center."""
    guess, lapse = estimate["lower_asymptote"], estimate["lapse_rate"]
    missing = (0.5 - lapse) / (1.0 - guess - lapse)
    return float(estimate["threshold"] + log10(-log(missing)) / estimate["slope"])


def _spread(quest: Any) -> float:
    """The standard deviation of the threshold, log10."""
    probability = quest.marginal_posterior["threshold"]
    mean = float((probability * quest.thresholds).sum())
    return sqrt(float((probability * (quest.thresholds - mean) ** 2).sum()))


def _grid() -> tuple[float, ...]:
    return tuple(step * log10(_STEP) for step in range(-_STEPS, _STEPS + 1))


def _is_at_edge(ratio: float) -> bool:
    return abs(log10(ratio)) > (_STEPS - 2) * log10(_STEP)


@cache
def _fresh() -> Any:
    """Made once, copied for each electrode. Any: questplus has no types."""
    from questplus import QuestPlusWeibull

    return QuestPlusWeibull(
        intensities=_grid(),
        thresholds=_grid(),
        slopes=_SLOPES,
        lower_asymptotes=(_GUESS,),
        lapse_rates=(_LAPSE,),
    )
