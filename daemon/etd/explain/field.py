"""Where current acts: the activating function under one electrode, and under a concentric one.

Owns: Figures 3 and 4 of Kajimoto, Electro-tactile Display, section 2.1, with their closed forms.
Must not know: drawing, the terminal.

The closed forms are derivatives of 1/r. For a ring, the mean over its points of the derivative
along one direction is half of that along both, and by Laplace's equation minus half of the one
downwards.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np

from etd.explain.figure import Axis, Check, Curve, Figure, floats
from etd_body.tissue import RESISTIVITY_OHM_M, Floats, activating_function, ring_mm

#: Cathodic: out of the skin at the stimulating electrode.
CURRENT_UA = -1_000.0
_STEP_MM = 0.02
_DEPTHS_MM = (0.75, 1.0, 1.25, 1.5, 2.0)
_RINGS_MM = (1.0, 1.5, 2.0, 3.0)
_SEEN_DEPTHS_MM = np.linspace(0.4, 4.0, 73)
#: A fibre that is reached at this is reached down to some depth, in mV per mm2.
_REACHING = 15.0
_CENTER = np.zeros((1, 2))


def activating_function_figure() -> Figure:
    """Figure 3."""
    return Figure(
        "activating-function",
        "Effect of a cathode on a fibre parallel to the skin",
        "Activating function along the fibre, for 1 mA at one point. Under the cathode it is"
        " positive: the fibre is depolarized. It falls with the cube of the depth, and is negative"
        " on both sides.",
        Axis("along the fibre (mm)", least=-4.0, most=4.0),
        Axis("activating function (mV/mm2)"),
        tuple(_along(depth_mm) for depth_mm in _DEPTHS_MM),
        (
            *(
                Check(
                    f"under the cathode, {depth_mm:g} mm deep, mV/mm2",
                    _at(0.0, depth_mm, _CENTER, np.array([CURRENT_UA])),
                    under_a_point(0.0, depth_mm),
                    "eq. 8: K / z3",
                )
                for depth_mm in _DEPTHS_MM
            ),
            Check(
                "2 mm beside it, 1 mm deep, mV/mm2",
                _at(2.0, 1.0, _CENTER, np.array([CURRENT_UA])),
                under_a_point(2.0, 1.0),
                "eq. 8: K (z2 - 2x2) / r5",
            ),
        ),
    )


def concentric() -> Figure:
    """Figure 4."""
    depths = floats(_SEEN_DEPTHS_MM)
    alone = Curve(
        "no ring", depths, tuple(under_a_point(0.0, depth) for depth in depths), dashed=True
    )
    return Figure(
        "concentric",
        "A wider ring of returns stimulates more strongly and deeper",
        "Activating function under the center of a concentric electrode, by the ring's radius. The"
        " ring is an anode and cancels part of the center's effect: the nearer, the more.",
        Axis("depth (mm)"),
        Axis("activating function (mV/mm2)", "log", least=1.0),
        (*(_down(ring) for ring in _RINGS_MM), alone),
        (
            *(
                Check(
                    f"ring of {ring:g} mm, {depth_mm:g} mm deep, mV/mm2",
                    _under_ring(ring, depth_mm),
                    under_a_ring(ring, depth_mm),
                    "K (1/z3 - (2z2 - R2) / 2 (R2 + z2)^5/2)",
                )
                for ring in _RINGS_MM
                for depth_mm in (1.0, 2.0)
            ),
            *(
                Check(
                    f"ring of {ring:g} mm, depth reached at {_REACHING:g} mV/mm2, mm",
                    reached_mm(ring, _under_ring),
                    reached_mm(ring, under_a_ring),
                    "the same, solved",
                )
                for ring in _RINGS_MM
            ),
        ),
    )


# --- the closed forms --------------------------------------------------------------------------


#: K in mV mm: the potential of the cathode is -K / r.
_STRENGTH = -RESISTIVITY_OHM_M * CURRENT_UA / (2.0 * pi)


def under_a_point(x_mm: float, depth_mm: float) -> float:
    """In mV/mm2: the second derivative of -K / r along x."""
    square = x_mm**2 + depth_mm**2
    return float(_STRENGTH * (depth_mm**2 - 2.0 * x_mm**2) / square**2.5)


def under_a_ring(ring: float, depth_mm: float) -> float:
    """In mV/mm2, in the middle of a ring that takes all of the current back."""
    opposite = (2.0 * depth_mm**2 - ring**2) / (2.0 * (ring**2 + depth_mm**2) ** 2.5)
    return under_a_point(0.0, depth_mm) - _STRENGTH * float(opposite)


# --- the model ---------------------------------------------------------------------------------


def _line(x_mm: float, depth_mm: float) -> Floats:
    offsets = np.array([-_STEP_MM, 0.0, _STEP_MM])
    return np.stack([x_mm + offsets, np.zeros(3), np.full(3, depth_mm)], axis=-1)


def _at(x_mm: float, depth_mm: float, sources: Floats, current_ua: Floats) -> float:
    return float(activating_function(_line(x_mm, depth_mm), sources, current_ua)[0])


def _under_ring(ring: float, depth_mm: float) -> float:
    around = ring_mm(ring)
    sources = np.concatenate([_CENTER, around])
    current = np.concatenate([[CURRENT_UA], np.full(len(around), -CURRENT_UA / len(around))])
    return _at(0.0, depth_mm, sources, current)


def reached_mm(ring: float, function: Callable[[float, float], float]) -> float:
    """The depth at which a function of (ring, depth) has fallen to what reaches a fibre."""
    shallow, deep = 0.1, 20.0
    while deep - shallow > 1e-6:
        middle = (shallow + deep) / 2.0
        if function(ring, middle) > _REACHING:
            shallow = middle
        else:
            deep = middle
    return deep


def _along(depth_mm: float) -> Curve:
    x_mm = np.linspace(-4.1, 4.1, 165)
    line = np.stack([x_mm, np.zeros_like(x_mm), np.full_like(x_mm, depth_mm)], axis=-1)
    values = activating_function(line, _CENTER, np.array([CURRENT_UA]))
    return Curve(f"{depth_mm:g} mm deep", floats(x_mm[1:-1]), floats(values))


def _down(ring: float) -> Curve:
    depths = floats(_SEEN_DEPTHS_MM)
    return Curve(
        f"ring of {ring:g} mm", depths, tuple(_under_ring(ring, depth) for depth in depths)
    )
