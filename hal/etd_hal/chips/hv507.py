"""HV507 (64 outputs) and HV513 (8 each, chained): half-bridges behind a shift register.

Owns: the order in which BL, POL, LE and the chain move so that every state in between is
harmless. Must not know: currents, timing of pulses, electrodes.

Function table (CLK LE BL POL -> outputs): BL 0 POL 0 all high; BL 0 POL 1 all low, the safe
state; BL 1 POL 1 the latch; BL 1 POL 0 its inverse. LE is transparent while high. Both low lines
at power-up would make all outputs high, so POL is set first and leaves last.
"""

from __future__ import annotations

from etd_hal.boardfile import HalfBridgeLines
from etd_hal.chips.chain import Chain
from etd_hal.ports import Changes, Gpio
from etd_hal.selection import Selection


def blanked(lines: HalfBridgeLines) -> Changes:
    """All outputs on ground, in one call: POL 1 comes first, being the lower line."""
    return ((lines.POL, 1), (lines.BL, 0))


class HalfBridgeSwitch:
    """One output against all others, either way round.

    In the kits VPP is the node of the current source: a high output is connected to the source,
    a low one to ground. A word of the chain has bit i set for output i.
    """

    #: There is no OPEN: an output is high or low.
    states: tuple[str, ...] = ("ANODE", "CATHODE", "SHORT")
    can_choose_returns = False

    def __init__(
        self, gpio: Gpio, lines: HalfBridgeLines, outputs: int, readback: int | None
    ) -> None:
        self._gpio = gpio
        self._chain = Chain(gpio, outputs, lines.DATA, lines.CLK, readback)
        self._fall_and_open: Changes = ((lines.LE, 1), (lines.CLK, 0))
        self._close_and_unblank: Changes = ((lines.LE, 0), (lines.BL, 1))
        self._close: Changes = ((lines.LE, 0),)
        self._unblank: Changes = ((lines.BL, 1),)
        self._direct: Changes = ((lines.POL, 1),)
        self._inverse: Changes = ((lines.POL, 0),)
        self._blank = blanked(lines)
        self._is_latch_open = False

    def reset(self) -> None:
        """After an error, and after safe_off: nothing is known of chain and latch."""
        self._chain.reset()
        self._is_latch_open = True

    def prepare(self, selection: Selection, whole: bool) -> None:
        """With the outputs blanked: put the word into the chain and open the latch to it."""
        # What the chain holds, the latch holds as well: every write ends with the latch open.
        if self._chain.held != selection.alone or whole:
            self._put(selection.alone, whole)

    def isolate(self, whole: bool) -> None:
        """With the outputs blanked: the same, with no output selected."""
        if self._chain.held != 0 or whole:
            self._put(0, whole)

    def _put(self, word: int, whole: bool) -> None:
        if self._is_latch_open:
            self._gpio.set(self._close)
            self._is_latch_open = False
        write = self._chain.rewrite if whole else self._chain.write
        write(word, self._fall_and_open)
        self._is_latch_open = True

    def connect(self, selection: Selection, is_anodic: bool) -> None:  # noqa: ARG002
        """Close the latch and un-blank, in this order. Into inverse polarity BL moves before POL,
        which takes a second call.
        """
        self.expose()
        if not is_anodic:
            self._gpio.set(self._inverse)

    def expose(self) -> None:
        """Close the latch and un-blank: the outputs are as the latch has them."""
        self._gpio.set(self._close_and_unblank if self._is_latch_open else self._unblank)
        self._is_latch_open = False

    def flip(self, selection: Selection, is_anodic: bool) -> None:  # noqa: ARG002
        """Swap anode and cathode without shifting."""
        self._gpio.set(self._direct if is_anodic else self._inverse)

    def discharge(self) -> None:
        """All outputs together on ground: POL 1, then BL 0, in one call."""
        self._gpio.set(self._blank)

    def release(self) -> None:
        """Blanked already."""

    def clear(self) -> None:
        """With the outputs blanked: zeros through the whole chain, latched."""
        if self._is_latch_open:
            self._gpio.set(self._close)
        self._chain.reset()
        self._chain.write(0, self._fall_and_open)
        self._gpio.set(self._close)
        self._is_latch_open = False

    def shift_behind(self, selection: Selection) -> None:
        """For a self-test, with the outputs blanked: another word into the chain, behind the closed
        latch. What was prepared before is what `connect` shows, if the latch holds it.
        """
        if self._is_latch_open:
            self._gpio.set(self._close)
            self._is_latch_open = False
        self._chain.write(selection.alone)
        # The latch holds something else: the next word is a whole one.
        self._chain.reset()

    def loop_back(self, sent: int) -> int:
        """With the outputs blanked and the latch closed: through the chain and back."""
        self._gpio.set(self._close)
        self._is_latch_open = False
        return self._chain.loop_back(sent)
