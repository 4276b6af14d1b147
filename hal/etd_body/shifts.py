"""What becomes of a threshold between pulses: use raises it, a neighbor's pulse lowers it.

Owns: the state of both, one number per electrode, on the times that it is given.
Must not know: nerves, currents, skin, clocks.

Both are of the touch fibres alone: pain stays where it is, so that what is turned up against
adaptation comes nearer to it [design].

*Use*: stimulation above threshold raises it: by 60 to 270 % after 15 minutes, and both adaptation
and recovery are complete in about as long (Kaczmarek 2000, IEEE Trans. Rehabil. Eng. 8:499, on the
abdomen). The course is an exponential with a third of that time, and what counts is the threshold
at rest: a pulse that is not felt any more is use as well [design].

*Summation*: a neighbor's pulse, of 10 to 50 % of its own threshold, lowers the threshold of the one
that follows by 18 to 36 % (Spatial summation of electro-tactile displays at subthreshold, 14
people). That a stronger one does the same, above its own threshold too, of which the source says
nothing, and how long the first one lasts are [design].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from etd_body.mesh import neighbors
from etd_body.tissue import Floats

#: A pulse above the threshold at rest is use for so long: once a second is in use.
_USED_NS = 1e9
#: Of its own threshold: what a neighbor's pulse must be to add.
_LEAST_SUMMED = 0.1


@dataclass(frozen=True, slots=True)
class FeelingFigures:
    """`adapted`: by how much of itself a threshold rises in the end (2.7 is 270 %). `summed`: the
    part of it that a neighbor's pulse takes, within `summed_ms` after it.
    """

    adapted: float = 0.0
    adapting_tau_s: float = 300.0
    summed: float = 0.0
    summed_ms: float = 20.0


#: Thresholds that stay as they are.
UNSHIFTED = FeelingFigures()


class Shifts:
    """Tell it the time (`let_pass`), and hand it every pulse when it is over (`shifted`)."""

    def __init__(
        self, figures: FeelingFigures, positions_mm: Sequence[tuple[float, float]]
    ) -> None:
        count = len(positions_mm)
        self._figures = figures
        self._neighbors = neighbors(positions_mm) > 0.0
        self._adapted: Floats = np.zeros(count)
        self._used_until_ns: Floats = np.full(count, -inf)
        self._summed_until_ns: Floats = np.full(count, -inf)
        self._t_ns: float | None = None

    def let_pass(self, t_ns: float) -> None:
        """What was in use adapts until then, the rest recovers."""
        from_ns = t_ns if self._t_ns is None else self._t_ns
        self._t_ns = max(t_ns, from_ns)
        tau_ns = self._figures.adapting_tau_s * 1e9
        elapsed_ns = self._t_ns - from_ns
        used_ns = np.clip(self._used_until_ns - from_ns, 0.0, elapsed_ns)
        adapted = 1.0 - (1.0 - self._adapted) * np.exp(-used_ns / tau_ns)
        self._adapted = np.asarray(adapted * np.exp(-(elapsed_ns - used_ns) / tau_ns))

    def raised(self, electrode: int) -> float:
        """The threshold over that of rest."""
        return 1.0 + self._figures.adapted * float(self._adapted[electrode])

    def shifted(self, peak: Floats, driven: int | None, t_ns: float) -> Floats:
        """How far each electrode's fibres were driven, over the thresholds that they have now.

        `peak`: the same over those of rest, by one pulse that ended at `t_ns`.
        """
        self._used_until_ns[peak >= 1.0] = t_ns + _USED_NS
        left = np.where(self._summed_until_ns >= t_ns, 1.0 - self._figures.summed, 1.0)
        if driven is not None and peak[driven] >= _LEAST_SUMMED:
            self._summed_until_ns[self._neighbors[driven]] = t_ns + self._figures.summed_ms * 1e6
        return np.asarray(peak / (left * (1.0 + self._figures.adapted * self._adapted)))
