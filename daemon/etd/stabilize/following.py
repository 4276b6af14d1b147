"""What all laws that follow a resistance have in common.

Owns: what they compare with, what they believe of it, and how fast they give more. Must not know:
what a law makes of a resistance, which part of a pulse it changes, limits.
"""

from __future__ import annotations

from etd.stabilize.pipeline import Known, Reach
from etd.stabilize.reference import References
from etd.stabilize.slew import Slew
from etd.stabilize.tell import Tell
from etd.stabilize.trust import Trust


class Following:
    """Of one law, which asks for at most `most_wider` times what is wanted, and comes there by at
    most `rise_per_s`.
    """

    def __init__(self, most_wider: float, rise_per_s: float, tell: Tell) -> None:
        self._most_wider = most_wider
        self._references = References()
        self._trust = Trust(most_wider, tell)
        self._factor = Slew(1.0, rise_per_s)
        self.reach = Reach(width=most_wider, charge=most_wider)

    def forget(self) -> None:
        """The supply was off. What is not believed stays so, since it goes by readings, and is told
        again.
        """
        self._trust.tell_again()
        self._references.forget()
        self._factor.forget()

    def compared(self, known: Known, wanted_ua: int) -> tuple[float, float, float] | None:
        """See `References.compared`."""
        return self._references.compared(known, wanted_ua)

    def believed(self, known: Known, wanted: float) -> float:
        """See `Trust.believed`."""
        return self._trust.believed(known.electrode, wanted, known.now_ns)

    def factor(self, known: Known, wanted: float) -> float:
        """What comes of a factor that is believed: bounded, no more than 1 at a soft contact; a
        rise takes its time, a fall is at once.
        """
        most = 1.0 if known.state == "soft" else self._most_wider
        return self._factor.toward(known.electrode, min(wanted, most), known.now_ns)
