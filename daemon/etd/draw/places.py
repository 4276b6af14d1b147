"""Where the electrodes of an array lie on paper, and how large what is written at them may be.

Owns: the way from an array's mm to the paper's, mirrored or not, and labels that never lie on one
another. Must not know: what is written, colors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot
from typing import Literal, NamedTuple

from etd.files.array import Array

#: Of a bold digit, in ems; and what separates two numbers.
DIGIT_EM, APART_EM = 0.73, 0.35
#: A line of digits with the space above it, half a digit's height, and the space below a label.
LINE_EM, HALF_EM, GAP_EM = 0.95, 0.40, 0.40


class Labels(NamedTuple):
    """How large the letters of all labels are, and where they stand: all lines inside the circle,
    all below it, or the first across its middle and the second below it.
    """

    size_mm: float
    where: Literal["inside", "below", "across"]

    def down_mm(self, lines: int) -> float:
        """How far they reach below the circles."""
        below = {"inside": 0, "across": lines - 1, "below": lines}[self.where]
        return self.size_mm * (below * LINE_EM + 0.1)


@dataclass(frozen=True)
class Places:
    """An array as a picture of `scale` mm for a mm of the array, `left` and `top` on the paper.

    Unmirrored as the file says it: seen through the finger, y upwards, towards the fingertip.
    """

    array: Array
    scale: float = 1.0
    mirrored: bool = False
    left: float = 0.0
    top: float = 0.0

    @cached_property
    def _extent(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper edge in the array's mm, of electrodes and sensors."""
        array, radius = self.array, self.array.diameter_mm / 2
        x = [it + side for it in array.x_mm for side in (-radius, radius)]
        y = [it + side for it in array.y_mm for side in (-radius, radius)]
        x += [sensor.x_mm for sensor in array.pressure]
        y += [sensor.y_mm for sensor in array.pressure]
        return min(x), max(x), min(y), max(y)

    @property
    def width(self) -> float:
        """On paper."""
        low, high, _, _ = self._extent
        return (high - low) * self.scale

    @property
    def height(self) -> float:
        _, _, low, high = self._extent
        return (high - low) * self.scale

    @property
    def diameter(self) -> float:
        """Of an electrode, on paper."""
        return self.array.diameter_mm * self.scale

    def at(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """A place of the array on the paper."""
        left, right, _, upper = self._extent
        across = right - x_mm if self.mirrored else x_mm - left
        return self.left + across * self.scale, self.top + (upper - y_mm) * self.scale

    def of_electrode(self, index: int) -> tuple[float, float]:
        electrode = self.array.electrode[index]
        return self.at(electrode.x_mm, electrode.y_mm)

    @property
    def axes(self) -> tuple[float, float] | None:
        """Where x = 0 and y = 0 lie on paper; None where that is beyond the electrodes."""
        left, right, lower, upper = self._extent
        return self.at(0.0, 0.0) if left <= 0.0 <= right and lower <= 0.0 <= upper else None


@dataclass(frozen=True)
class Spacing:
    """How near electrodes come to one another, in the array's mm: across, and up.

    Only those pairs that no other pair is nearer than in both ways: they decide for all.
    """

    nearest: tuple[tuple[float, float], ...]
    pitch_mm: float

    @classmethod
    def of(cls, array: Array) -> Spacing:
        x, y = array.x_mm, array.y_mm
        pairs = sorted(
            {(abs(x[a] - x[b]), abs(y[a] - y[b])) for a in range(array.count) for b in range(a)}
        )
        front: list[tuple[float, float]] = []
        for pair in pairs:
            if not front or pair[1] < front[-1][1]:
                front.append(pair)
        return cls(tuple(front), min(hypot(*pair) for pair in pairs))

    def labels(
        self, scale: float, diameter: float, digits: int, lines: int, most: float
    ) -> tuple[Labels, ...]:
        """The largest labels of one or two lines of so many digits (`diameter` on paper), at most
        `most`, for each place: no two lie on one another, nor on a neighbor's circle.
        """
        wide_em = DIGIT_EM * digits
        below = across = most
        for right, up in self.nearest:
            dx, dy = right * scale, up * scale
            beside = dx / (wide_em + APART_EM) if dx >= diameter else 0.0
            below = min(below, max(beside, (dy - diameter) / (LINE_EM * lines + GAP_EM), 0.0))
            across = min(across, max(beside, _fits_across(dy, diameter, lines)))
        room = min(diameter, self.pitch_mm * scale)
        inside = min(most, 0.92 * room / hypot(wide_em, LINE_EM * lines))
        return Labels(inside, "inside"), Labels(below, "below"), Labels(across, "across")


def _fits_across(up: float, diameter: float, lines: int) -> float:
    """The letters of a label with `up` to the next one, when its first line is across the circle.
    It takes the larger of circle and letters, above the middle and below it, and what stands below.
    """
    half, taken_em = diameter / 2, LINE_EM * (lines - 1) + GAP_EM
    return max(
        0.0,
        min((up - whole * half) / (taken_em + (2 - whole) * HALF_EM) for whole in (0, 1, 2)),
    )
