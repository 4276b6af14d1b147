"""The potential that currents through the skin make in the tissue under it.

Owns: point sources on a half-space, superposed, and disks and rings made of them.
Must not know: nerves, electrodes' circuits, time.

Kajimoto, Electro-tactile Display, section 2.1: around a point source on a uniform medium the
equipotential surfaces are hemispheres, and with several current-controlled electrodes their
potentials are superposed. Lengths in mm, z downwards from the layer that the current comes
through; currents in uA, positive into the skin; potentials in mV.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Of wet, living skin; only its product with a nerve's threshold matters [design].
RESISTIVITY_OHM_M = 2.5
_GOLDEN_ANGLE = pi * (3.0 - sqrt(5.0))


def potential_per_ua(points_mm: Floats, sources_mm: Floats) -> Floats:
    """mV at each point for 1 uA into each source: shape (..., points, sources).

    `points_mm` is (..., points, 3), `sources_mm` (sources, 2), all on the surface z = 0.
    """
    # Axis by axis: a sum over an axis of two takes several times as long.
    x_mm = points_mm[..., :, None, 0] - sources_mm[:, 0]
    y_mm = points_mm[..., :, None, 1] - sources_mm[:, 1]
    distance_mm = np.sqrt((x_mm**2 + y_mm**2) + points_mm[..., :, None, 2] ** 2)
    return np.asarray(RESISTIVITY_OHM_M / (2.0 * pi * distance_mm))


def disk_mm(radius_mm: float, count: int = 25) -> Floats:
    """Points that stand for an even current through a disk: each carries 1/count of it."""
    index = np.arange(count)
    radius = radius_mm * np.sqrt((index + 0.5) / count)
    angle = index * _GOLDEN_ANGLE
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def ring_mm(radius_mm: float, count: int = 24) -> Floats:
    """Points evenly on a circle: the return of a concentric electrode (section 2.1, Figure 4)."""
    angle = np.arange(count) * (2.0 * pi / count)
    return radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def activating_function(line_mm: Floats, sources_mm: Floats, current_ua: Floats) -> Floats:
    """The second difference of the potential along evenly spaced points, in mV per mm2.

    The right side of equation 8 (section 2.1) without G_a, at all points but the first and last.
    """
    potential_mv = potential_per_ua(line_mm, sources_mm) @ current_ua
    step_mm = float(np.linalg.norm(line_mm[1] - line_mm[0]))
    second = potential_mv[2:] - 2.0 * potential_mv[1:-1] + potential_mv[:-2]
    return np.asarray(second / step_mm**2)
