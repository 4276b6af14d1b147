"""Where current goes with the skin as it is, for whatever is connected.

Owns: the reading of `sides` as one network (who stands alone, who returns and with which share,
what passes beside the skin), remembered until the skin changes.
Must not know: time, charges, nerves.

What is lumped: the side with several electrodes is a resistance that shares the current by
conductance; what floats and is bridged to the lone electrode passes beside the skin as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from etd_body.interface import Side, Sides
from etd_body.mesh import Beside, Mask, beside
from etd_body.skin import Skin
from etd_body.source import Loop
from etd_body.tissue import Floats

_CACHED_MASKS = 2_048
#: What returns share when their resistance, which depends on it, is looked up.
_MIDDLING_UA = 1_000.0
_NOTHING_BESIDE = Beside(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Masks:
    """`sides`, sorted once. `lone` stands against all others at once, in `direction`, or None."""

    sides: Sides
    sources: Mask
    grounds: Mask
    lone: int | None
    direction: int


@dataclass(slots=True)
class Way:
    """`weights`: what each electrode carries of 1 A through the skin, the lone one +1.

    `lone` is the electrode alone on its side, if current can flow through it; `direction` is +1
    when that side is the source's, and 0 when no current can flow.
    """

    lone: int | None
    direction: int
    weights: Floats
    rest_ohm: float
    shunt_s: float
    is_against_all: bool
    #: The nerves' answer to it, kept here once it is known.
    pattern: NDArray[np.float32] | None = None


class Ways:
    """`use_skin` after every change of the skin; `of` whenever something else is connected."""

    def __init__(self, skin: Skin) -> None:
        self._skin = skin
        self._masks: dict[int, Masks] = {}
        self._ways: dict[int, Way] = {}
        self.use_skin()

    def use_skin(self) -> None:
        """Forget what was read of another skin, and add up what all electrodes have together."""
        skin = self._skin
        self._ways.clear()
        #: Every electrode's way into the tissue at a small current, in S.
        self.conductance_s = skin.conductance_at(0.0)
        self._is_all_skin = bool(skin.is_skin.all())
        self._touching = int(skin.is_touching.sum())
        self._total_s = float(self.conductance_s.sum())
        each_ua = _MIDDLING_UA / max(1, self._touching - 1)
        self._returning_s = float(skin.conductance_at(each_ua).sum())
        self._bridges_s = skin.bridges_s.sum(axis=1) if skin.has_bridges else None

    def masks(self, sides: Sides) -> Masks:
        """Known by identity: the same tuple object for the same state."""
        found = self._masks.get(id(sides))
        if found is None:
            if len(self._masks) >= _CACHED_MASKS:
                self._masks.clear()
                self._ways.clear()
            found = self._masks[id(sides)] = _sorted(sides)
        return found

    def of(self, sides: Sides) -> Way:
        masks = self.masks(sides)
        found = self._ways.get(id(sides))
        if found is None:
            found = self._ways[id(sides)] = self._read(masks)
        return found

    def against_all(self, electrode: int) -> Way:
        """One electrode on the source, all others on ground."""
        count = range(len(self.conductance_s))
        return self._read(_sorted(tuple(Side(1 if other == electrode else 2) for other in count)))

    def loop(self, way: Way, electrode: int, source_a: float, leak_s: float, top_v: float) -> Loop:
        """The source, told `source_a`, with the lone electrode as it is at that current."""
        skin = self._skin
        series_ohm = float(skin.series_ohm[electrode]) + way.rest_ohm
        leak_ohm = 1.0 / (leak_s + way.shunt_s)
        passing_a = source_a
        for _ in range(3):
            parallel_ohm = skin.parallel_at(electrode, passing_a * 1e6)
            wanted_a = source_a * leak_ohm / (leak_ohm + series_ohm + parallel_ohm)
            passing_a = min(wanted_a, top_v / (series_ohm + parallel_ohm))
        parallel_ohm = skin.parallel_at(electrode, passing_a * 1e6)
        capacitance_f = float(skin.capacitance_nf[electrode]) * 1e-9
        return Loop(source_a, leak_ohm, top_v, series_ohm, parallel_ohm, capacitance_f)

    def _read(self, masks: Masks) -> Way:
        skin = self._skin
        if masks.lone is not None and skin.is_touching[masks.lone] and self._touching > 1:
            return self._read_one_against_all(masks.lone, masks.direction)
        side = _NOTHING_BESIDE
        if skin.has_bridges:
            side = beside(skin.bridges_s, self.conductance_s, masks.sources, masks.grounds)
        sources, grounds = masks.sources & skin.is_touching, masks.grounds & skin.is_touching
        lone, direction = _lone(sources, grounds)
        if direction == 0:
            nothing = np.zeros(len(self.conductance_s))
            return Way(None, 0, nothing, inf, side.source_ground_s, False)
        into, out = self.conductance_s * sources, self.conductance_s * grounds
        weights = (into / into.sum() - out / out.sum()) * direction
        if lone is None:
            rest_ohm = 1.0 / float(into.sum()) + 1.0 / float(out.sum())
            return Way(None, 1, weights, rest_ohm, side.source_ground_s, False)
        others = grounds if direction > 0 else sources
        to_lone_s, to_others_s = side.source_tissue_s, side.ground_tissue_s
        if direction < 0:
            to_lone_s, to_others_s = to_others_s, to_lone_s
        rest_s = self._returns_s(others) + to_others_s
        shunt_s = side.source_ground_s
        if to_lone_s > 0.0:
            shunt_s += 1.0 / (1.0 / to_lone_s + 1.0 / rest_s)
        is_all = int(others.sum()) + 1 == self._touching and self._is_all_skin
        return Way(lone, direction, weights, 1.0 / rest_s, shunt_s, is_all)

    def _read_one_against_all(self, lone: int, direction: int) -> Way:
        """The usual case, from the sums: nothing floats."""
        own_s = float(self.conductance_s[lone])
        weights = self.conductance_s * (-1.0 / (self._total_s - own_s))
        weights[lone] = 1.0
        rest_s = self._returning_s * (1.0 - own_s / self._total_s)
        shunt_s = 0.0 if self._bridges_s is None else float(self._bridges_s[lone])
        return Way(lone, direction, weights, 1.0 / rest_s, shunt_s, self._is_all_skin)

    def _returns_s(self, others: Mask) -> float:
        """Each at the part of a middling current that it carries."""
        each_ua = _MIDDLING_UA / max(1, int(others.sum()))
        return float(self._skin.conductance_at(each_ua)[others].sum())


def _sorted(sides: Sides) -> Masks:
    sources = np.fromiter((side is Side.SOURCE for side in sides), bool, len(sides))
    grounds = np.fromiter((side is Side.GROUND for side in sides), bool, len(sides))
    lone, direction = _lone(sources, grounds)
    if not (sources | grounds).all():
        lone = None
    return Masks(sides, sources, grounds, lone, direction)


def _lone(sources: Mask, grounds: Mask) -> tuple[int | None, int]:
    """The electrode alone on its side, and the direction; 0 when current cannot flow."""
    if not (sources.any() and grounds.any()):
        return None, 0
    if int(sources.sum()) == 1:
        return int(sources.argmax()), 1
    if int(grounds.sum()) == 1:
        return int(grounds.argmax()), -1
    return None, 1
