"""The fake's SPI, whose ADC answers the pulses of a record with what was measured then.

Owns: which words of an answer are replaced. Must not know: where the measurements come from, what
is made of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from etd_body.interface import Side, Sides
from etd_hal.boardfile import Source
from etd_hal.ports import Message, Spi

#: Baseline, early and end sample of a phase.
_SAMPLES_A_PHASE = 3


class ReplayedSpi:
    """`expect` says what the next pulse measured; everything else measures the fake's own body."""

    def __init__(self, inner: Spi, source: Source, sides: Callable[[], Sides]) -> None:
        self._inner = inner
        self._sides = sides
        self._most_code = source.codes - 1
        self._node_v = source.node_uv_per_code / 1_000_000
        self._samples_v: Sequence[float] = ()
        self._electrode = -1
        self._early_at = 1

    def expect(self, electrode: int, samples_v: Sequence[float], *, has_prepulse: bool) -> None:
        """The next pulse at this electrode measured these, three for each phase. A pulse at another
        electrode is none of it.
        """
        self._electrode = electrode
        self._samples_v = samples_v
        self._early_at = 2 if has_prepulse else 1

    def prepare(self, message: Message) -> None:
        """See `ports.Spi`."""
        self._inner.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        """See `ports.Spi`."""
        received = self._inner.transfer(message)
        if len(received) < _SAMPLES_A_PHASE or not self._samples_v or not self._is_expected():
            return received
        phase, self._samples_v = self._samples_v[:3], self._samples_v[3:]
        baseline_v, early_v, end_v = phase
        words = list(received)
        words[-1] = self._word(end_v)
        words[self._early_at] = self._word(early_v)
        words[0] = self._word(baseline_v)
        return tuple(words)

    def _is_expected(self) -> bool:
        """Whether current flows through that electrode, and it is no return."""
        sides = self._sides()
        side = sides[self._electrode]
        return side is not Side.OPEN and sides.count(side) == 1 and len(set(sides)) > 1

    def _word(self, volts: float) -> bytes:
        """As the AD7276 sends it (datasheet rev. C): two zeros, twelve bits, two zeros."""
        code = min(self._most_code, max(0, round(volts / self._node_v)))
        return (code << 2).to_bytes(2, "big")
