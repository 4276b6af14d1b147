"""A law that stands at its widest for long is not believed any more.

Owns: how near and how long that is, and when it ends. Must not know: what a law goes by, limits.

A divider that makes bad contact on one electrode reads like wet skin, and holds a law at the most
that it may ask for. Skin is there too, but not for so long: on the busiest modelled fingers (seeds
1 and 2, ten minutes) `fitted` wants nearly its most for 7 and 13 % of the time, in stretches of
seconds. To give up after 10 s takes 4 and 2 of 1000 pulses from it there.

What a law wants counts, by resistances that are believed; so pulses by others, and pauses, neither
fill nor end it, nor does an arming. Nor does a moment at which less is wanted: what is wrong for
more than half of the time must not be believed for the rest. Time away from there counts against
it, and the doubt ends when that has used up what was counted. Time not so far away takes back what
led to a doubt, and never ends one. Where a site allows more than twice the width, near is what it
would be at twice.
"""

from __future__ import annotations

from etd.stabilize.tell import Tell

#: In parts of the way, as logarithms, from unchanged to the widest.
_NEAR, _AWAY = 0.8, 0.5
_LONG_NS = 10_000_000_000
#: Whatever a site allows: a law that wants as much as this for long is not believed.
_WIDE = 2.0
#: Between two pulses no more than this counts.
_LONGEST_STEP_NS = 1_000_000_000


class EndStop:
    """For all electrodes of one law. `tell` hears "bound" when it is not believed at one."""

    def __init__(self, most: float, tell: Tell) -> None:
        most = min(most, _WIDE)
        self._near = most**_NEAR if most > 1.0 else float("inf")
        self._away = most**_AWAY
        self._tell = tell
        self._stood_ns: dict[int, int] = {}
        self._asked_ns: dict[int, int] = {}
        self._doubted: set[int] = set()

    def believed(self, electrode: int, wanted: float, now_ns: int) -> float:
        """What a law wants by what is measured, as a factor; 1 where it has wanted its most for too
        long, until it has wanted less than half of the way for as long.
        """
        self._count(electrode, wanted, now_ns)
        stood_ns = self._stood_ns[electrode]
        if stood_ns == 0:
            self._doubted.discard(electrode)
        elif electrode not in self._doubted and stood_ns >= _LONG_NS:
            self._doubted.add(electrode)
            self._tell("bound")
        return min(wanted, 1.0) if electrode in self._doubted else wanted

    def _count(self, electrode: int, wanted: float, now_ns: int) -> None:
        elapsed_ns = now_ns - self._asked_ns.get(electrode, now_ns)
        elapsed_ns = min(max(0, elapsed_ns), _LONGEST_STEP_NS)
        self._asked_ns[electrode] = now_ns
        stood_ns = self._stood_ns.get(electrode, 0)
        if wanted >= self._near:
            stood_ns += elapsed_ns
        elif wanted < self._away or electrode not in self._doubted:
            stood_ns -= elapsed_ns
        self._stood_ns[electrode] = min(max(0, stood_ns), _LONG_NS)
