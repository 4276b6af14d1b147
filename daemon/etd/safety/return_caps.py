"""The return of a pulse that reaches its cap first, when all other electrodes are its returns.

Owns: the caps of all electrodes, weighed by what each may conduct beside the others. Must not know:
how conductances are measured, how old they are, ledgers, clocks.

A return that is not known may carry the whole current, so the pulse gets no more than its cap. A
known one carries at most

    most(i) / (most(i) + sum of least(k) over all others except the stimulated electrode)

The stimulated electrode counts as the best of the others, so that one figure holds for the pulses
of all electrodes. Where all are alike, nothing is lost by that.

That is so once the capacitances of the skin are charged. Until then each return that touches
carries about as much as any other, however it resists: none counts for less than an equal part. Nor
does one that is open: until it is polled again, a touch of it is not known.

Skin resists less at higher currents, and a return carries another current than the one it was
measured with. So the others are taken to conduct as at no current, and the return itself as at its
cap: by the law of docs/body.md, in which R x (I + 8 mA) is constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from etd.pulse.measured import BEND_UA

#: The current at which the first return reaches its cap, and that return.
ReturnBound = tuple[float, int]


class Known:
    """What one electrode conducts, in S, measured at `read_ua`."""

    __slots__ = ("least_s", "most_s", "read_ua", "touches")

    def __init__(self, least_s: float, most_s: float, read_ua: float, touches: bool) -> None:
        self.least_s: Final = least_s
        self.most_s: Final = most_s
        self.read_ua: Final = read_ua
        self.touches: Final = touches

    @property
    def as_other_s(self) -> float:
        """The least that it conducts at a small current."""
        return self.least_s * BEND_UA / (BEND_UA + self.read_ua)

    def as_return_s(self, cap_ua: int) -> float:
        """The most that it conducts at the current of its cap."""
        return self.most_s * max(1.0, (BEND_UA + cap_ua) / (BEND_UA + self.read_ua))


class ReturnCaps:
    """The bounds of pulses at any electrode, for the returns as they are known now (None: not
    known).
    """

    def __init__(self, caps_ua: Sequence[int], known: Sequence[Known | None]) -> None:
        others_s = [0.0 if it is None else it.as_other_s for it in known]
        whole_s = sum(others_s)
        next_s, best_s = sorted(others_s)[-2:]
        best = others_s.index(best_s)
        touching = sum(it is not None and it.touches for it in known)
        bounds: list[ReturnBound] = []
        for electrode, (cap_ua, it) in enumerate(zip(caps_ua, known, strict=True)):
            beside_s = whole_s - others_s[electrode] - (next_s if electrode == best else best_s)
            bounds.append((_bound_ua(cap_ua, it, max(0.0, beside_s), touching), electrode))
        #: The second counts where the first is stimulated.
        self._first, self._second = sorted(bounds)[:2]

    def of(self, electrode: int) -> ReturnBound:
        """The bound of the pulses of this electrode."""
        return self._second if self._first[1] == electrode else self._first


def _bound_ua(cap_ua: int, known: Known | None, beside_s: float, touching: int) -> float:
    if known is None:
        return float(cap_ua)
    return_s = known.as_return_s(cap_ua)
    # One of those that touch is the stimulated one; an open one would be one more return.
    equal_ua = float(cap_ua * max(1, touching - known.touches))
    return equal_ua if return_s == 0.0 else min(equal_ua, cap_ua * (1.0 + beside_s / return_s))
