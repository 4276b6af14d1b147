"""A chain of shift register stages, clocked through GPIO: what all switch chips have in common.

Owns: the model of what the chain holds, and the fewest clocks to what it shall hold.
Must not know: what a stage switches, latches, blanking.

Stage 0 is nearest to DATA and is bit 0 of a word. Shifting is on the rising edge of CLK. DATA and
CLK of one call rise in this order because DATA has the lower line number (the board file's rule).
"""

from __future__ import annotations

from etd_hal.errors import BoardFault
from etd_hal.ports import Changes, Gpio

_MAX_REMEMBERED = 4096


class Chain:
    """The stages and their driver. `held` is None while their content is not known."""

    def __init__(
        self, gpio: Gpio, stages: int, data: int, clock: int, readback: int | None = None
    ) -> None:
        self._gpio = gpio
        self._stages = stages
        self._full = (1 << stages) - 1
        self._rise: tuple[Changes, Changes] = (
            ((data, 0), (clock, 1)),
            ((data, 1), (clock, 1)),
        )
        self._fall: Changes = ((clock, 0),)
        self._readback = readback
        self._clocks: dict[tuple[int, int], int] = {}
        self.held: int | None = None

    def reset(self) -> None:
        """After any error: the content is not known, the next write is a whole one."""
        self.held = None

    def write(self, wanted: int, last_fall: Changes | None = None) -> None:
        """Shift until the chain holds `wanted`; `last_fall` replaces the last falling edge's call.

        The caller sees to it that the latch is closed. Raises: BusError.
        """
        held = self.held
        self._ensure_low(held)
        clocks = self._stages if held is None else self._fewest(held, wanted)
        if clocks == 0:
            if last_fall is not None:
                self._gpio.set(last_fall)
            return
        self.held = None
        for position in range(clocks - 1, -1, -1):
            self._gpio.set(self._rise[wanted >> position & 1])
            self._gpio.set(last_fall if position == 0 and last_fall is not None else self._fall)
        self.held = wanted

    def rewrite(self, wanted: int, last_fall: Changes | None = None) -> None:
        """Shift the whole chain; where the board reads it back, check what comes out.

        Raises: BusError; BoardFault if what comes out is not what went in a scan ago.
        """
        held, self.held = self.held, None
        self._ensure_low(held)
        checks = self._bits_to_check(held)
        for position in range(self._stages - 1, -1, -1):
            if position in checks and self._readback is not None:
                self._check_out(checks[position])
            self._gpio.set(self._rise[wanted >> position & 1])
            self._gpio.set(last_fall if position == 0 and last_fall is not None else self._fall)
        self.held = wanted

    def loop_back(self, sent: int) -> int:
        """Shift `sent` through the whole chain, then zeros, and return what came out.

        The caller sees to it that the latch is closed; the content is not known afterwards.
        Raises: BusError; BoardFault on a board that does not read its chain back.
        """
        if self._readback is None:
            raise BoardFault("switch register readback", "absent", "a line for it")
        self.reset()
        self.write(sent)
        self.reset()
        received = 0
        for _ in range(self._stages):
            received = received << 1 | self._gpio.get(self._readback)
            self._gpio.set(self._rise[0])
            self._gpio.set(self._fall)
        return received

    def _ensure_low(self, held: int | None) -> None:
        """A call that failed may have left CLK high, and the first rise would be none."""
        if held is None:
            self._gpio.set(self._fall)

    def _fewest(self, held: int, wanted: int) -> int:
        key = (held, wanted)
        clocks = self._clocks.get(key)
        if clocks is None:
            clocks = fewest_clocks(held, wanted, self._stages)
            if len(self._clocks) >= _MAX_REMEMBERED:
                self._clocks.clear()
            self._clocks[key] = clocks
        return clocks

    def _bits_to_check(self, held: int | None) -> dict[int, int]:
        """One stage that holds a one and one that holds a zero: {position in the shift: bit}.

        Stage s stands at the output after (stages - 1 - s) clocks, which is when bit `s` of the
        new word is about to go in.
        """
        if held is None or self._readback is None:
            return {}
        ones = held
        zeros = ~held & self._full
        found = ((ones, 1), (zeros, 0))
        return {bits.bit_length() - 1: value for bits, value in found if bits}

    def _check_out(self, expected: int) -> None:
        line = self._readback
        if line is not None and self._gpio.get(line) != expected:
            raise BoardFault("switch register readback", str(1 - expected), str(expected))


def fewest_clocks(held: int, wanted: int, stages: int) -> int:
    """The smallest k with wanted[k:] == held[:stages - k] (DESIGN: selection)."""
    for clocks in range(stages):
        kept = (1 << (stages - clocks)) - 1
        if wanted >> clocks == held & kept:
            return clocks
    return stages
