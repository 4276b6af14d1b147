"""HV507 and HV513 chains: shift register, transparent latch, and the BL/POL function table.

Owns: the register and the outputs it makes. Typed from the chips' function table, for the fake.
Must not know: the driver's model of the register, current.

Shifts on CLK rising, whatever LE, BL and POL are; the latch follows while LE is high. BL 0 makes
all outputs high (POL 0) or low (POL 1); BL 1 makes them the latch (POL 1) or its inverse (POL 0).
High is the source's node, low is ground; there is no third state. The register holds anything at
power-up.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

from etd_body.interface import Side, Sides
from etd_hal.fake.faults import AlsoSwitches, LatchIgnored, SwitchOutput
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.shifting import shifted
from etd_hal.fake.wiring import WiringFault, outputs_behind, wiring_faults

_CACHED_SIDES = 4_096
_SHIFTING = frozenset(("CLK", "DATA"))


class HalfBridgeChain:
    """`on_sides(t_ns, sides)` is called when the outputs of electrodes change."""

    def __init__(
        self,
        outputs: int,
        electrodes: Sequence[int],
        faults: Faults,
        on_sides: Callable[[int, Sides], None],
        *,
        seed: int,
    ) -> None:
        self._outputs = outputs
        self._all = (1 << outputs) - 1
        self._electrodes = tuple(electrodes)
        self._faults = faults
        self._on_sides = on_sides
        self._levels = {"POL": 1, "DATA": 0, "LE": 0, "BL": 0, "CLK": 0}
        power_up = random.Random(seed)
        self._register = power_up.getrandbits(outputs)
        self._latch = power_up.getrandbits(outputs)
        self._high = 0
        #: The faults' count of changes when the outputs were last determined.
        self._driven_at = faults.changes
        self._cache: dict[tuple[int, tuple[WiringFault, ...]], Sides] = {}
        self.sides = self._sides_of(0)

    @property
    def blanked_high(self) -> bool:
        """BL 0 with POL 0: every output on the source's node."""
        return not self._levels["BL"] and not self._levels["POL"]

    @property
    def data_out(self) -> int:
        """The level of the last stage, which the chain's data output shows."""
        return self._register >> (self._outputs - 1)

    @property
    def shorted(self) -> bool:
        """A half-bridge cannot."""
        return False

    def settle(self, t_ns: int) -> None:
        """Half-bridges switch at once: nothing is ever under way."""

    def set(self, t_ns: int, name: str, level: int) -> None:
        """An input of the chain is at `level` from now on; one that was there has no edge."""
        was, self._levels[name] = self._levels[name], level
        if name == "CLK" and level and not was:
            self._register = shifted(self._register, self._levels["DATA"], self._faults) & self._all
        if name == "LE" and level and not was and self._faults.edge_is_wrong(LatchIgnored):
            self._levels["LE"] = 0
        if self._levels["LE"]:
            self._latch = self._register
        elif name in _SHIFTING and self._driven_at == self._faults.changes:
            # Behind a closed latch no output changes: most calls end here.
            return
        self._drive(t_ns)

    def _drive(self, t_ns: int) -> None:
        levels = self._levels
        self._driven_at = self._faults.changes
        if levels["BL"]:
            latch = self._latched()
            high = latch if levels["POL"] else latch ^ self._all
        else:
            high = 0 if levels["POL"] else self._all
        if high != self._high:
            self.sides = self._sides_of(high)
            self._on_sides(t_ns, self.sides)
            self._high = high

    def _latched(self) -> int:
        """With the stages that others take along."""
        latch = self._latch
        if not self._faults.are_there:
            return latch
        now = "anodic" if self._levels["POL"] else "cathodic"
        for both in self._faults.of(AlsoSwitches):
            if both.polarity not in (None, now):
                continue
            latch |= (self._latch >> both.output & 1) << both.also
        return latch

    def _sides_of(self, high: int) -> Sides:
        """One object for one state, as long as the cache lasts: the body caches by identity."""
        wrong = wiring_faults(self._faults)
        found = self._cache.get((high, wrong))
        if found is None:
            if len(self._cache) >= _CACHED_SIDES:
                self._cache.clear()
            found = self._cache[high, wrong] = self._new_sides(high)
        return found

    def _new_sides(self, high: int) -> Sides:
        stays = {
            switch_output.output: Side[switch_output.side.upper()]
            for switch_output in self._faults.of(SwitchOutput)
        }
        return tuple(
            stays.get(output, Side.SOURCE if high >> output & 1 else Side.GROUND)
            for output in outputs_behind(self._electrodes, self._faults)
        )
