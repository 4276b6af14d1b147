"""How much of what a measured resistance asks for is believed.

Owns: the rules and their order. Must not know: what a law goes by, limits.

First what all electrodes have in common for long (`in_common.py`), which a wrong gain is, is taken
out of a widening; then an electrode that stands at its widest by itself (`end_stop.py`) is given
up: it gets the pulse that the frame wants. What is left is still bounded by the law's own
`most_wider`. One that stands at its narrowest is told, and stays there: nothing tells a reading
that is too high from an edge of skin that carries all, and that one would be hurt by what the frame
wants. All of them judge readings and no skin: who touches, and whether the supply was off
meanwhile, is nothing to them; but who comes then is told again.
"""

from __future__ import annotations

from etd.stabilize.end_stop import EndStop, narrowest, widest
from etd.stabilize.in_common import Common
from etd.stabilize.tell import Tell


class Trust:
    """For all electrodes of one law, which widens `most` times at most."""

    def __init__(self, most: float, tell: Tell) -> None:
        self._common = Common(tell)
        self._widest = EndStop(widest(most), lambda: tell("bound"))
        self._narrowest = EndStop(narrowest(), lambda: tell("narrow"))

    def believed(self, electrode: int, wanted: float, now_ns: int) -> float:
        """Of what a law wants by what is measured, as a factor above 0; never more than that."""
        own = self._common.taken_from(electrode, wanted, now_ns)
        # Told, no more.
        self._narrowest.is_doubted(electrode, 1.0 / own, now_ns)
        return min(own, 1.0) if self._widest.is_doubted(electrode, own, now_ns) else own

    def tell_again(self) -> None:
        """What is doubted now is news to whoever comes."""
        for one in (self._common, self._widest, self._narrowest):
            one.tell_again()
