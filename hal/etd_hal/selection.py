"""Which outputs are on which side, for a pulse of one electrode.

Owns: the two sets of a selection, and which selections a board can make. Must not know: chips'
words, lines, currents.
"""

from __future__ import annotations

from typing import Final, Protocol

from etd_hal.boardfile import BoardFile, Relays
from etd_hal.errors import CannotSelect


class Selection:
    """The selected output alone on its side, its returns on the other side, as bit sets.

    Anodic: the selected output on source, the returns on ground. Cathodic: the reverse.
    """

    __slots__ = ("alone", "output", "returns")

    def __init__(self, output: int, returns: int) -> None:
        self.output: Final = output
        self.returns: Final = returns
        #: The selected output's own bit.
        self.alone: Final = 1 << output

    def source(self, is_anodic: bool) -> int:
        return self.alone if is_anodic else self.returns

    def ground(self, is_anodic: bool) -> int:
        return self.returns if is_anodic else self.alone


class Selections:
    """Which selections a board can make, by its file."""

    def __init__(self, file: BoardFile) -> None:
        self._switch = file.switch

    def selection(self, output: int, returns: tuple[int, ...] | None) -> Selection:
        """One output against `returns`, or against all others (None).

        Raises: CannotSelect, where the board has no open state, or an output is not there.
        """
        outputs = self._switch.outputs
        for electrode in (output, *(returns or ())):
            if not 0 <= electrode < outputs:
                raise CannotSelect(electrode, "selected", f"the board has {outputs}")
        others = ((1 << outputs) - 1) & ~(1 << output)
        wanted = others if returns is None else sum({1 << electrode for electrode in returns})
        if wanted & ~others:
            raise CannotSelect(output, "selected", "it is among its own returns")
        if not wanted:
            raise CannotSelect(output, "selected", "it has no return")
        if wanted != others and not isinstance(self._switch, Relays):
            left_out = (others & ~wanted).bit_length() - 1
            raise CannotSelect(
                left_out,
                "left open",
                f"the {self._switch.chip} connects every output to the source or to ground;"
                ' on this board returns are "all"',
            )
        return Selection(output, wanted)


class Switch(Protocol):
    """What `board.py` needs of a switch chip's driver. All raise BusError."""

    @property
    def states(self) -> tuple[str, ...]:
        """The states an electrode can be in, of ANODE, CATHODE, OPEN, SHORT."""
        ...

    @property
    def can_choose_returns(self) -> bool:
        """Whether returns can be fewer than all others."""
        ...

    def prepare(self, selection: Selection, whole: bool) -> None:
        """Do what is possible while the electrode before still rests. `whole`: rewrite the
        chain.
        """
        ...

    def connect(self, selection: Selection, is_anodic: bool) -> None:
        """Connect; on return the pulse may begin."""
        ...

    def flip(self, selection: Selection, is_anodic: bool) -> None:
        """Between the phases of a biphasic pulse, with the DAC at zero."""
        ...

    def discharge(self) -> None:
        """Begin to discharge the skin."""
        ...

    def release(self) -> None:
        """After the rest, without a next pulse: nothing stays connected."""
        ...

    def isolate(self, whole: bool) -> None:
        """After the rest: nothing connected, and no output selected. `whole`: see `prepare`."""
        ...

    def clear(self) -> None:
        """Nothing selected, from a register of which nothing is known."""
        ...

    def reset(self) -> None:
        """After an error, and after safe_off: the next `prepare` writes everything."""
        ...

    def loop_back(self, sent: int) -> int:
        """For a self-test: a word as long as the chain, and what came out of its end.

        `clear` puts things right again. Raises BoardFault too, without a line to read it on.
        """
        ...
