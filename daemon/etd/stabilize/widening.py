"""How much of the widening that a measured resistance asks for is believed.

Owns: the two rules and their order. Must not know: what a law goes by, limits.

First what all electrodes have in common for long (`in_common.py`), which a wrong gain is, is taken
out; then an electrode that stands at its widest by itself (`end_stop.py`) is given up. What is left
is still bounded by the law's own `most_wider`. Both judge readings and no skin: who touches, and
whether the supply was off meanwhile, is nothing to them.
"""

from __future__ import annotations

from etd.stabilize.end_stop import EndStop
from etd.stabilize.in_common import Common
from etd.stabilize.tell import Tell


class Widening:
    """For all electrodes of one law, which widens `most` times at most."""

    def __init__(self, most: float, tell: Tell) -> None:
        self._common = Common(tell)
        self._end_stop = EndStop(most, tell)

    def believed(self, electrode: int, wanted: float, now_ns: int) -> float:
        """Of what a law wants by what is measured, as a factor above 0; never more than that."""
        own = self._common.taken_from(electrode, wanted, now_ns)
        return self._end_stop.believed(electrode, own, now_ns)
