"""A modelled person who is asked how strong it is: how they judge it, how often they err, and when
they answer.

Owns: the answer to a strength, and the time until the next one. Must not know: bodies, daemons,
what is made of the answers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etd.stabilize.offset_estimate import Answer
from etd_body.tissue import Floats

#: Without anything else they answer once a minute.
ANSWERS_S = 60.0
#: Who insists says so soon again that it is still too strong.
INSISTS_S = 10.0
#: A pulse at so many times its threshold is felt as this power of it (docs/body.md).
EXPONENT = 1.2
_ANSWERS: tuple[Answer, ...] = ("too_weak", "good", "too_strong")


@dataclass(frozen=True)
class Manner:
    """How somebody answers: `right` so often, and *good* within `band` of what was calibrated.
    `errs`: what they say where they err; None: one of the other two, as likely. `insists`: who said
    *too strong* answers again soon.
    """

    right: float = 0.8
    band: float = 0.2
    errs: Answer | None = None
    insists: bool = False


class Person:
    """Compares what is felt with the strength that was wanted when it was calibrated."""

    def __init__(self, manner: Manner, seed: int, number: int = 0) -> None:
        """`number`: of those who have the finger of this seed."""
        self._manner = manner
        self._random = np.random.default_rng([seed, 11, number])

    def says(self, times_wanted: float) -> Answer:
        """Once asked, right or not."""
        right = self.judges(times_wanted)
        if self._random.random() < self._manner.right:
            return right
        if self._manner.errs is not None:
            return self._manner.errs
        others = [answer for answer in _ANSWERS if answer != right]
        return others[int(self._random.integers(2))]

    def judges(self, times_wanted: float) -> Answer:
        """Without an error."""
        band = 1.0 + self._manner.band
        if times_wanted > band:
            return "too_strong"
        return "too_weak" if times_wanted < 1.0 / band else "good"

    def again_s(self, said: Answer) -> float:
        """Until they answer again."""
        insists = self._manner.insists and said == "too_strong"
        return INSISTS_S if insists else ANSWERS_S


def wanted_strength(current_ua: Floats, threshold_ua: Floats) -> Floats:
    """Felt when it was calibrated, by electrode; 0 where nothing was."""
    found = np.zeros(len(current_ua))
    felt = (current_ua > 0.0) & (threshold_ua > 0.0)
    found[felt] = (current_ua[felt] / threshold_ua[felt]) ** EXPONENT
    return found


def times_wanted(felt: Floats, wanted: Floats) -> float:
    """[scan, electrode] of the last scans, by the strength that was wanted: the mean. Where nothing
    was wanted, because the calibration left no level, nothing is what was wanted.
    """
    is_wanted = wanted > 0.0
    if not is_wanted.any():
        return 1.0
    return float(np.mean(felt.mean(axis=0)[is_wanted] / wanted[is_wanted]))
