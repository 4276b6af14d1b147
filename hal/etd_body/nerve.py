"""The fibres under an array of electrodes, and how far a current anywhere drives each of them.

Owns: which fibres there are (depth, thickness, direction, spread), equation 7 on the potential of
all electrodes, and its reduction to a few exponentials that a pulse can be reckoned with quickly.
Must not know: skin, sources, pulses, what is felt.

Under every electrode lie four fibres (Kajimoto, Electro-tactile Display, sections 2.2.1 and 2.3):
a thick vertical one that ends near the surface, as Meissner's corpuscle's does; a thick one that
runs parallel to the surface; and two thin ones, nearer to the surface, whose work is pain. The
ending of a vertical fibre is a large piece of bare membrane, which anodic current enters by; it
leaves at the nodes below, and depolarizes them. Depths count from below the corneal layer, which
the current comes through. Depths, diameters and spreads are [design].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etd_body.membrane import Membrane, NerveConstants
from etd_body.tissue import Floats, disk_mm, potential_per_ua

Sites = NDArray[np.intp]

#: The time constants that every response is reckoned with, in us.
TAU_US = np.array([8.0, 30.0, 90.0, 250.0, 700.0])
#: Radii of the current's way in for which the own electrode's effect is tabulated, in mm.
RADII_MM = np.array([0.08, 0.15, 0.22, 0.3, 0.4, 0.5, 0.62, 0.78, 1.0, 1.4])
NOMINAL_RADIUS_MM = 0.5
#: Each fibre is looked at where anodic current acts most at once, where it does so later, and
#: where cathodic current does.
SITES = 3
_FITTED_AT_US = np.geomspace(8.0, 1_000.0, 40)
_SITES_AT_US = (15.0, 120.0)
#: Where pain is said to begin at so many times the threshold: of what pulse, and the spread of it
#: between electrodes [design].
_PAIN_AT_US, _PAIN_SIGMA = 100.0, 0.1


@dataclass(frozen=True, slots=True)
class FibreKind:
    """`ending`: how many nodes' membrane a vertical fibre's ending is worth."""

    name: str
    hurts: bool
    is_vertical: bool
    diameter_um: float
    depth_mm: float
    nodes: int = 19
    spacing_mm: float = 0.25
    ending: float = 40.0

    def line_mm(self) -> Floats:
        """The nodes of one that lies under the origin, (nodes, 3)."""
        along = np.arange(self.nodes) * self.spacing_mm
        line = np.zeros((self.nodes, 3))
        if self.is_vertical:
            line[:, 2] = self.depth_mm + along
        else:
            line[:, 1] = along - along[-1] / 2.0
            line[:, 2] = self.depth_mm
        return line

    def second_difference(self) -> Floats:
        """The operator of equation 7, (nodes, nodes), with sealed ends."""
        inner = -2.0 * np.eye(self.nodes) + np.eye(self.nodes, k=1) + np.eye(self.nodes, k=-1)
        inner[0, 0] = inner[-1, -1] = -1.0
        return np.asarray(inner)

    def membrane(self) -> Membrane:
        constants = NerveConstants.of_diameter(self.diameter_um)
        size = np.ones(self.nodes)
        if self.is_vertical:
            size[0] = self.ending
        matrix = np.diag(constants.membrane_us * size)
        matrix -= constants.inside_us * self.second_difference()
        return Membrane(matrix, constants.capacitance_pf * size)

    def drive_per_mv(self) -> Floats:
        """What the potential outside drives the membrane with, (nodes, nodes), uS.

        Where a fibre goes on beyond the last node, the potential does so in a straight line.
        """
        operator = self.second_difference()
        operator[-1] = 0.0
        if not self.is_vertical:
            operator[0] = 0.0
        return np.asarray(NerveConstants.of_diameter(self.diameter_um).inside_us * operator.T)


#: All fibres alike; with the tissue's resistivity it puts a middling threshold at 0.6 mA, 100 us.
THRESHOLD_MV = 15.0
TOUCH_VERTICAL = FibreKind("touch, vertical", False, True, 10.0, 0.4)
TOUCH_PARALLEL = FibreKind("touch, parallel", False, False, 10.0, 0.55, nodes=25)
PAIN_VERTICAL = FibreKind("pain, vertical", True, True, 1.5, 0.25)
PAIN_PARALLEL = FibreKind("pain, parallel", True, False, 1.7, 0.25, nodes=25)
KINDS = (TOUCH_VERTICAL, TOUCH_PARALLEL, PAIN_VERTICAL, PAIN_PARALLEL)
#: Of an electrode's fibres the first so many are felt, the others hurt.
TOUCH_ROWS = SITES * sum(not kind.hurts for kind in KINDS)
ROWS = SITES * len(KINDS)


@dataclass(frozen=True, slots=True)
class NerveSpread:
    """Log-normal spreads between electrodes: of depth, and of a fibre's own threshold [design]."""

    depth_sigma: float = 0.05
    threshold_sigma: float = 0.15
    #: A layer between electrodes and skin, a gel's thickness: everything lies that much deeper.
    extra_depth_mm: float = 0.0
    #: The least, over the electrodes, that pain is of the touch threshold (one pulse of 100 us by
    #: the nominal way in); None: what the fibres' own figures make of it, about 3.
    pain_times: float | None = None


class Nerves:
    """Responses per uA, as amplitudes of `TAU_US` in fractions of a site's threshold.

    `everywhere[j, :, row, e]` is what 1 uA into electrode j does under electrode e: (electrodes,
    taus, ROWS, electrodes). `own[e, r]` is electrode e at its own sites, its current entering by a
    disk of `RADII_MM[r]`: (electrodes, radii, taus, ROWS).
    """

    def __init__(
        self,
        positions_mm: Sequence[tuple[float, float]],
        *,
        seed: int,
        spread: NerveSpread = NerveSpread(),
    ) -> None:
        places = np.array(positions_mm, dtype=float)
        count = self.electrode_count = len(places)
        taus = len(TAU_US)
        self.everywhere: Floats = np.zeros((count, taus, ROWS, count))
        self.own: Floats = np.zeros((count, len(RADII_MM), taus, ROWS))
        random = np.random.default_rng([seed, 1])
        # Depths belong to a place: what lies under one electrode is all a little deeper, or not.
        deeper = np.exp(random.normal(0.0, spread.depth_sigma, count))
        for index, kind in enumerate(KINDS):
            weaker = np.exp(random.normal(0.0, spread.threshold_sigma, count))
            lines = kind.line_mm()[None].repeat(count, axis=0)
            lines[:, :, 2] += (deeper[:, None] - 1.0) * kind.depth_mm + spread.extra_depth_mm
            rows = slice(index * SITES, (index + 1) * SITES)
            self._place(kind, lines, places, weaker * THRESHOLD_MV, rows)
        if spread.pain_times is not None:
            above = np.abs(np.random.default_rng([seed, 6]).normal(0.0, _PAIN_SIGMA, count))
            self._make_pain_begin_at(spread.pain_times * np.exp(above))

    def _make_pain_begin_at(self, times: Floats) -> None:
        """Of each electrode's touch threshold: the thin fibres' thresholds are scaled to it."""
        grown = -np.expm1(-_PAIN_AT_US / TAU_US)
        nominal = int(np.abs(RADII_MM - NOMINAL_RADIUS_MM).argmin())
        reached = np.einsum("t,etr->er", grown, self.own[:, nominal])
        touch = reached[:, :TOUCH_ROWS].max(axis=1)
        scale = touch / (reached[:, TOUCH_ROWS:].max(axis=1) * times)
        self.own[..., TOUCH_ROWS:] *= scale[:, None, None, None]
        self.everywhere[:, :, TOUCH_ROWS:] *= scale

    def _place(
        self, kind: FibreKind, lines: Floats, places: Floats, threshold_mv: Floats, rows: slice
    ) -> None:
        """One kind's fibres under all electrodes; `lines` (electrodes, nodes, 3) from its own."""
        seen = _Seen(kind)
        own = np.stack([disk_potential(lines, radius) for radius in RADII_MM], axis=1)
        sites = seen.sites(disk_potential(lines, NOMINAL_RADIUS_MM))
        by_radius = np.swapaxes(seen.amplitudes(own, sites[:, None]), -1, -2)
        self.own[..., rows] = by_radius / threshold_mv[:, None, None, None]
        for electrode, place in enumerate(places):
            outside = potential_per_ua(lines[electrode], places - place).T
            found = np.swapaxes(seen.amplitudes(outside, sites[electrode]), -1, -2)
            self.everywhere[:, :, rows, electrode] = found / threshold_mv[electrode]


class _Seen:
    """One kind's membrane with its modes folded into `TAU_US`."""

    def __init__(self, kind: FibreKind) -> None:
        self._membrane = kind.membrane()
        self._drive_per_mv = kind.drive_per_mv()
        grown = -np.expm1(-_FITTED_AT_US[:, None] * self._membrane.rates)
        basis = -np.expm1(-_FITTED_AT_US[:, None] / TAU_US)
        #: Every mode's growth as a sum of ours: (modes, taus)
        self._fold = np.linalg.lstsq(basis, grown, rcond=None)[0].T

    def sites(self, outside_mv: Floats) -> Sites:
        """Depolarized most by anodic current, soon and late, and by cathodic: (..., SITES)."""
        drive = outside_mv @ self._drive_per_mv
        soon, late = (self._membrane.step_response(drive, t_us) for t_us in _SITES_AT_US)
        return np.stack([soon.argmax(-1), late.argmax(-1), late.argmin(-1)], axis=-1)

    def amplitudes(self, outside_mv: Floats, sites: Sites) -> Floats:
        """(..., SITES, taus) in mV for potentials (..., nodes), seen at `sites` (..., SITES)."""
        shapes = self._membrane.shapes(outside_mv @ self._drive_per_mv)
        wide = np.broadcast_to(sites[..., None], (*shapes.shape[:-2], SITES, shapes.shape[-1]))
        return np.asarray(np.take_along_axis(shapes, wide, axis=-2) @ self._fold)


def disk_potential(lines_mm: Floats, radius_mm: float) -> Floats:
    """mV at points (..., 3) for 1 uA through a disk around the origin."""
    return np.asarray(potential_per_ua(lines_mm, disk_mm(radius_mm)).mean(axis=-1))
