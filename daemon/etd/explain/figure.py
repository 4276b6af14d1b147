"""A figure: curves, and checks against closed forms.

Owns: the types, and their JSON. Must not know: how curves are computed or drawn.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal, SupportsFloat

Scale = Literal["linear", "log"]


@dataclass(frozen=True, slots=True)
class Curve:
    """Points in order. A dashed curve is a formula's, beside the model's."""

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Check:
    """A number of the model beside the same number by a formula."""

    what: str
    modelled: float
    closed_form: float
    source: str

    @property
    def error_percent(self) -> float:
        return 100.0 * abs(self.modelled / self.closed_form - 1.0)


@dataclass(frozen=True, slots=True)
class Axis:
    """`least` and `most` are the axis's ends; by default those of the curves."""

    label: str
    scale: Scale = "linear"
    least: float | None = None
    most: float | None = None


@dataclass(frozen=True, slots=True)
class Figure:
    """`says` describes what the figure shows."""

    name: str
    title: str
    says: str
    x: Axis
    y: Axis
    curves: tuple[Curve, ...]
    checks: tuple[Check, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "figure": self.name,
            "title": self.title,
            "says": self.says,
            "checks": [
                {**asdict(check), "error_percent": check.error_percent} for check in self.checks
            ],
            "x": self.x.label,
            "y": self.y.label,
            "curves": [{"name": curve.name, "x": curve.x, "y": curve.y} for curve in self.curves],
        }


def floats(values: Iterable[SupportsFloat]) -> tuple[float, ...]:
    """Plain floats, of numpy's or any numbers."""
    return tuple(float(supports_float) for supports_float in values)
