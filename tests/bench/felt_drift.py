"""Whether a finger's drift is common to all its electrodes: its variation without any law, split.

Owns: the parts of the split, the share from which a drift is called common, and what is left of the
variation where a part is taken from all electrodes alike. Must not know: answers, what is heeded,
what bound follows.

What is split is the logarithm of how many times its threshold each electrode gets, scan by scan
while its contact is firm: a common factor on currents adds the same to all of them. (What is *felt*
does not split so: below the threshold it is nothing, and nothing that is divided by a mean stays
nothing.) Of its variance over time, about each electrode's own mean:

- *drift*: explained by which minute it is, alike for all electrodes: what somebody who answers once
  a minute can tell;
- *moments*: explained by which scan it is, beyond that: pressing and peeling;
- *own*: the rest, each electrode by itself.

A drift is common to all where it explains enough of the variance, and is large enough to be told:
on skin that hardly changes at all a small drift may be most of what there is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import inf, isinf, isnan, log, nan

import numpy as np
from numpy.typing import NDArray

from bench.felt_known import Known
from bench.felt_play import MINUTES, SCAN_NS
from etd.stabilize.offset_estimate import BAND
from etd.stabilize.said_electrode import MOST
from etd_body.kinds import BodyKind
from etd_body.tissue import Floats

_MINUTE_NS = 60_000_000_000
#: A drift is common to all where it explains at least so much of the variance over time [design],
#: and its standard deviation is at least what anybody calls good anyway.
COMMON, LEAST_SIZE = 1.0 / 3.0, BAND
#: Common offsets that are tried, as logarithms: where the strength is levelled to.
_OFFSETS = np.linspace(-1.0, 1.0, 81)


@dataclass(frozen=True)
class Drift:
    """The first three are parts of 1. `size`: the standard deviation of the drift, as a logarithm
    of the current that would make up for it. The rest is variation over time, in times of that
    without a law, where something is taken from all electrodes alike with everything known
    beforehand, at whatever rate, under the caps: each moment's mean; each minute's; each minute's
    with no more than 1.2 times the frame's current.
    """

    drift: float
    moments: float
    own: float
    size: float
    left_moments: float
    left_minutes: float
    left_at_most: float

    @property
    def is_common(self) -> bool:
        return self.drift >= COMMON and self.size >= LEAST_SIZE


def drift(kind: BodyKind, seed: int, minutes: float = MINUTES) -> Drift:
    """Of one finger; all nan where nothing is asked for, because its calibration left no level."""
    known = Known(kind, seed, minutes)
    firm = known.firm
    played = np.where(firm, known.at_frame[-len(firm) :], np.nan)
    deviation = played[:, firm.any(axis=0) & known.is_played]
    if not deviation.size:
        return Drift(*(nan,) * len(fields(Drift)))
    deviation = deviation - np.nanmean(deviation, axis=0)
    moment = np.arange(len(firm))
    minute = moment * SCAN_NS // _MINUTE_NS
    by_moment, by_minute = course(deviation, moment), course(deviation, minute)
    return Drift(
        *parts(deviation, by_moment, by_minute),
        size=float(by_minute.std()),
        left_moments=_left(known, by_moment, inf),
        left_minutes=_left(known, by_minute, inf),
        left_at_most=_left(known, by_minute, log(MOST)),
    )


def parts(deviation: Floats, by_moment: Floats, by_minute: Floats) -> tuple[float, float, float]:
    """Drift, moments, own: of the variance of [scan, electrode] about each electrode's mean."""
    all_of_it = float(np.nansum(deviation**2))
    slow = 1.0 - float(np.nansum((deviation - by_minute[:, None]) ** 2)) / all_of_it
    own = float(np.nansum((deviation - by_moment[:, None]) ** 2)) / all_of_it
    return slow, 1.0 - own - slow, own


def mean_of(found: Sequence[Drift]) -> Drift:
    """Of several fingers; what is left of the variation, of those that have one."""
    of_all = {each.name: [getattr(one, each.name) for one in found] for each in fields(Drift)}
    told = {
        name: [value for value in values if not isnan(value)] for name, values in of_all.items()
    }
    return Drift(**{name: float(np.mean(values or [nan])) for name, values in told.items()})


def course(deviation: Floats, of_scan: NDArray[np.int_]) -> Floats:
    """Of [scan, electrode], with holes: at each scan the mean over all that is of the same time; 0
    where nothing is.
    """
    count = int(of_scan[-1]) + 1
    scans, _ = np.nonzero(~np.isnan(deviation))
    values = deviation[~np.isnan(deviation)]
    sums = np.bincount(of_scan[scans], weights=values, minlength=count)
    numbers = np.bincount(of_scan[scans], minlength=count)
    return np.asarray((sums / np.maximum(numbers, 1))[of_scan])


def _left(known: Known, taken: Floats, most: float) -> float:
    """At the best common strength, in times of the variation with nothing taken; nan where nothing
    is felt then.
    """
    whole = np.concatenate([np.full(known.count - len(taken), taken[0]), taken])
    factors = np.minimum(_OFFSETS[:, None] - whole[None], most)
    nothing = np.zeros((1, known.count))
    every = slice(0, known.count)
    plain = float(known.variations(known.felt(nothing, every))[0])
    if isinf(plain):
        return nan
    return float(np.nanmin(known.variations(known.felt(factors, every)))) / plain
