"""Figures of Kajimoto's paper, computed with the fake's body model.

Owns: their names on the command line. A figure is made by a function without arguments. It has
curves, and checks of the model against closed forms.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.explain.field import activating_function_figure, concentric
from etd.explain.figure import Figure
from etd.explain.strength import optimal_width, strength_duration, thickness

FIGURES: dict[str, Callable[[], Figure]] = {
    "strength-duration": strength_duration,
    "activating-function": activating_function_figure,
    "concentric": concentric,
    "optimal-width": optimal_width,
    "thickness": thickness,
}
