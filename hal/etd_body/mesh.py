"""What lies beside the skin's own way: films of sweat, paste or gel between the electrodes.

Owns: the bridges between neighbors, and the reduction of electrodes that float (connected to
neither side) to what they are worth between source, ground and tissue.
Must not know: time, sources, capacitors.

Kajimoto, Electro-tactile Display, section 3.3: with paste between electrodes 1-2 mm apart the
current passes the paste and reaches the neighbors without penetrating the skin; a gel of the
skin's own conductance, thick enough, spreads the current instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from etd_body.tissue import Floats

Mask = NDArray[np.bool_]

#: Neighbors lie within this many times the smallest distance.
_NEIGHBOR = 1.2


@dataclass(frozen=True, slots=True)
class Gel:
    """A layer between electrodes and skin: thick, and about as conductive as skin."""

    thickness_mm: float
    resistivity_ohm_m: float

    def series_ohm(self, diameter_mm: float) -> float:
        """Straight through, under one electrode."""
        return self.resistivity_ohm_m * self.thickness_mm * 4e3 / (pi * diameter_mm**2)

    def bridge_ohm(self, gap_mm: float, diameter_mm: float) -> float:
        """Along the layer from one electrode to the next."""
        return self.resistivity_ohm_m * gap_mm * 1e3 / (diameter_mm * self.thickness_mm)


def neighbors(positions_mm: Sequence[tuple[float, float]]) -> Floats:
    """1 for each pair of electrodes next to one another, otherwise 0: (electrodes, electrodes)."""
    places = np.array(positions_mm, dtype=float)
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    np.fill_diagonal(apart, np.inf)
    return np.asarray((apart <= _NEIGHBOR * apart.min()).astype(float))


@dataclass(frozen=True, slots=True)
class Beside:
    """Conductances in S between source and ground, source and tissue, ground and tissue."""

    source_ground_s: float
    source_tissue_s: float
    ground_tissue_s: float


def beside(bridges_s: Floats, conductance_s: Floats, sources: Mask, grounds: Mask) -> Beside:
    """All ways but the connected electrodes' own skin.

    `bridges_s` (electrodes, electrodes), `conductance_s` from each electrode into the tissue.
    """
    direct_s = float(bridges_s[np.ix_(sources, grounds)].sum())
    floating = ~(sources | grounds)
    to_source = bridges_s[floating][:, sources].sum(axis=1)
    to_ground = bridges_s[floating][:, grounds].sum(axis=1)
    if not (to_source.any() or to_ground.any()):
        return Beside(direct_s, 0.0, 0.0)
    # Films alone can isolate a group of electrodes from everything: it has no potential then.
    matrix = np.diag(bridges_s[floating].sum(axis=1) + conductance_s[floating] + 1e-15)
    matrix -= bridges_s[np.ix_(floating, floating)]
    from_source = np.linalg.solve(matrix, to_source)
    from_ground = np.linalg.solve(matrix, to_ground)
    return Beside(
        direct_s + float(to_ground @ from_source),
        float(conductance_s[floating] @ from_source),
        float(conductance_s[floating] @ from_ground),
    )
