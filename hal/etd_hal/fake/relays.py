"""74HC595 registers with two photorelays an electrode, which take their time.

Owns: the registers, and each relay on its way. Typed from the parts' datasheets, for the fake.
Must not know: the driver's break-before-make, current.

Shifts on SRCLK (the board file's CLK) rising; the outputs copy the register on RCLK (LE) rising.
OE is tied low: at power-up the outputs are anything. A relay closes `ton_us` after its output
rises and opens `toff_us` after it falls. Stage 0 is nearest DATA; channel c has stage 2c + on_bit
to the source and 2c + return_bit to ground.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

from etd_body.interface import Side, Sides
from etd_hal.boardfile import Relays
from etd_hal.fake.faults import AlsoSwitches, LatchIgnored, SwitchOutput
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.shifting import shifted
from etd_hal.fake.wiring import WiringFault, outputs_behind, wiring_faults

_CACHED_STATES = 4_096
_SIDE_OF_PAIR = {(0, 0): Side.OPEN, (1, 0): Side.SOURCE, (0, 1): Side.GROUND, (1, 1): Side.SOURCE}


class RelayChain:
    """`on_sides(t_ns, sides, shorted)` is called when relays have moved.

    `shorted` tells that some electrode has both its relays closed: source on ground.
    """

    def __init__(
        self,
        switch: Relays,
        electrodes: Sequence[int],
        faults: Faults,
        on_sides: Callable[[int, Sides, bool], None],
        *,
        seed: int,
    ) -> None:
        self._stages = 2 * switch.outputs
        self._all = (1 << self._stages) - 1
        self._switch = switch
        self._electrodes = tuple(electrodes)
        self._faults = faults
        self._on_sides = on_sides
        self._levels = {"DATA": 0, "LE": 0, "CLK": 0}
        power_up = random.Random(seed)
        self._register = power_up.getrandbits(self._stages)
        self._outputs = power_up.getrandbits(self._stages)
        self._closed = self._outputs
        #: What is under way: (time, stages that close or open then, those of them that close).
        self._moves: list[tuple[int, int, int]] = []
        self._cache: dict[tuple[int, tuple[WiringFault, ...]], Sides] = {}
        self.sides = self._sides_of(self._closed)

    @property
    def data_out(self) -> int:
        """QH' of the last chip."""
        return self._register >> (self._stages - 1)

    @property
    def shorted(self) -> bool:
        """Some electrode has both its relays closed."""
        closed = self._really(self._closed)
        pairs = closed & (closed >> 1)
        return any(pairs >> 2 * channel & 1 for channel in range(self._switch.outputs))

    @property
    def blanked_high(self) -> bool:
        """No such state here."""
        return False

    def set(self, t_ns: int, name: str, level: int) -> None:
        """An input of the chain is at `level` from now on; one that was there has no edge."""
        was, self._levels[name] = self._levels[name], level
        if level == was:
            return
        if name == "CLK" and level:
            self._register = shifted(self._register, self._levels["DATA"], self._faults) & self._all
        elif name == "LE" and level and not self._faults.edge_is_wrong(LatchIgnored):
            self._copy(t_ns)

    def settle(self, t_ns: int) -> None:
        """Move the relays that are due by `t_ns`, each at its time."""
        while self._moves and self._moves[0][0] <= t_ns:
            move = self._moves.pop(0)
            try:
                self._move(*move)
            except BaseException:
                # Broken off: it is still to come.
                self._moves.insert(0, move)
                raise

    def _move(self, due_ns: int, stages: int, closing: int) -> None:
        before = self._closed
        closed = (before & ~stages) | closing
        if closed == before:
            return
        self._closed = closed
        self.sides = self._sides_of(closed)
        try:
            self._on_sides(due_ns, self.sides, self.shorted)
        except BaseException:
            self._closed = before
            raise

    def _copy(self, t_ns: int) -> None:
        changed = self._register ^ self._outputs
        self._outputs = self._register
        # A relay that is driven back before it moved stays as it is.
        self._moves = [(due, stages & ~changed, on & ~changed) for due, stages, on in self._moves]
        closing = changed & self._register
        opening = changed & ~self._register
        if closing:
            self._moves.append((t_ns + self._switch.ton_us * 1_000, closing, closing))
        if opening:
            self._moves.append((t_ns + self._switch.toff_us * 1_000, opening, 0))
        self._moves.sort()

    def _sides_of(self, closed: int) -> Sides:
        wrong = wiring_faults(self._faults)
        found = self._cache.get((closed, wrong))
        if found is None:
            if len(self._cache) >= _CACHED_STATES:
                self._cache.clear()
            really = self._really(closed)
            found = self._cache[closed, wrong] = tuple(
                self._side_of(really, channel)
                for channel in outputs_behind(self._electrodes, self._faults)
            )
        return found

    def _really(self, closed: int) -> int:
        """With the relays that others close along with theirs; its other one stays as it is."""
        switch = self._switch
        for both in self._faults.of(AlsoSwitches):
            bit = switch.return_bit if both.polarity == "cathodic" else switch.on_bit
            closed |= (closed >> (2 * both.output + bit) & 1) << (2 * both.also + bit)
        return closed

    def _side_of(self, closed: int, channel: int) -> Side:
        for fault in self._faults.of(SwitchOutput):
            if fault.output == channel:
                return Side[fault.side.upper()]
        pair = closed >> 2 * channel
        return _SIDE_OF_PAIR[pair >> self._switch.on_bit & 1, pair >> self._switch.return_bit & 1]
