"""A value at each electrode's place, as a shade and as a number, and the scale beside it.

Owns: maps that are not to scale: cells as large as their neighbors let them be, on paper of a
bounded size. Must not know: what the values are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot
from typing import NamedTuple

from msgspec.structs import replace

from etd.draw.palette import FAINT, PAPER, SOFT, ink_on, shade
from etd.draw.places import DIGIT_EM, LINE_EM, Places, Spacing
from etd.draw.sheet import MIDDLE_EM, Sheet, text_width_mm
from etd.files.array import Array


class CellSize(NamedTuple):
    """From electrode to electrode, in mm: the most, and the least as long as the map stays within
    its own bound. More than `map_mm` is taken for the least only.
    """

    most_mm: float
    least_mm: float
    map_mm: float
    most_map_mm: float


#: With numbers of four digits in each cell.
NUMBERED = CellSize(10.0, 7.0, 76.0, 400.0)
#: Of a cell, so that neighbors do not touch.
_FILLED = 0.94
_STEPS = 24


@dataclass(frozen=True, slots=True)
class Scale:
    """From the lowest to the highest value that is shown, both included."""

    low: float
    high: float

    def fraction(self, value: float) -> float:
        """0 to 1; the middle where all values are the same."""
        span = self.high - self.low
        return (value - self.low) / span if span > 0 else 0.5


@dataclass(frozen=True, slots=True)
class Cells:
    """The places of a map and the circle at each, in mm on paper."""

    at: Places
    diameter: float

    @classmethod
    def of(cls, array: Array, spacing: Spacing, size: CellSize) -> Cells:
        """The upper left corner of the map is at 0, 0. Electrodes are points, whatever their true
        size is, and sensors are left out.
        """
        points = Places(replace(array, diameter_mm=0.0, pressure=()))
        cells = max(points.width, points.height) / spacing.pitch_mm + 1
        cell = min(size.most_mm, max(size.least_mm, size.map_mm / cells), size.most_map_mm / cells)
        return cls(Places(points.array, cell / spacing.pitch_mm), _FILLED * cell).moved(0.0, 0.0)

    @property
    def width(self) -> float:
        return self.at.width + self.diameter

    @property
    def height(self) -> float:
        return self.at.height + self.diameter

    def moved(self, left: float, top: float) -> Cells:
        """The same with the upper left corner there."""
        radius = self.diameter / 2
        at = Places(self.at.array, self.at.scale, left=left + radius, top=top + radius)
        return Cells(at, self.diameter)

    def letters_mm(self, digits: int, lines: int = 2) -> float:
        """The size at which a number of so many digits fits, below a smaller one."""
        return 0.95 * self.diameter / hypot(DIGIT_EM * digits, LINE_EM * lines)


def value_map(
    sheet: Sheet, cells: Cells, values: list[int | None], scale: Scale, mark: str, letters_mm: float
) -> None:
    """A cell for each electrode: its number, and below it the value; None is crossed out."""
    for index, value in enumerate(values):
        x, y = cells.at.of_electrode(index)
        radius = cells.diameter / 2
        fill = PAPER if value is None else shade(scale.fraction(value))
        ink = SOFT if value is None else ink_on(fill)
        dashes = "0.8 0.6" if value is None else ""
        sheet.circle(
            x, y, radius, fill=fill, stroke=SOFT, dashes=dashes, mark=f"{mark}-electrode-{index}"
        )
        if value is None:
            away = radius * 0.7
            sheet.line(x - away, y + away, x + away, y - away, stroke=FAINT, width=0.15)
        small = 0.8 * letters_mm
        sheet.text(
            x, y - 0.12 * letters_mm, str(index), size=small, anchor="middle", color=ink,
            mark=f"{mark}-number-{index}",
        )  # fmt: skip
        sheet.text(
            x, y + 0.83 * letters_mm, "–" if value is None else str(value), size=letters_mm,
            anchor="middle", color=ink, bold=True, mark=f"{mark}-value-{index}",
        )  # fmt: skip


def key_map(sheet: Sheet, cells: Cells, mark: str) -> None:
    """The number of each electrode at its place."""
    digits = len(str(cells.at.array.count - 1))
    size = min(2.6, cells.letters_mm(digits, lines=1))
    for index in range(cells.at.array.count):
        x, y = cells.at.of_electrode(index)
        sheet.circle(x, y, cells.diameter / 2, mark=f"{mark}-electrode-{index}")
        sheet.text(
            x, y + MIDDLE_EM * size, str(index), size=size, anchor="middle",
            mark=f"{mark}-number-{index}",
        )  # fmt: skip


def scale_bar(
    sheet: Sheet,
    x: float,
    y: float,
    width: float,
    ends: tuple[str, str],
    color: Callable[[float], str] = shade,
) -> None:
    """The colors of 0 to 1, from light to dark, with what the ends mean; one color where the ends
    are the same.
    """
    low, high = ends
    size, down = 2.4, 4.0
    left = x + text_width_mm(low, size) + 1.2
    right = x + width - text_width_mm(high, size) - 1.2
    sheet.text(x, y + 2.9, low, size=size)
    if low == high:
        sheet.rect(left, y, 6.0, down, fill=color(0.5), stroke=SOFT)
        return
    step = (right - left) / _STEPS
    for number in range(_STEPS):
        fill = color(number / (_STEPS - 1))
        sheet.rect(left + number * step, y, step * 1.02, down, fill=fill)
    sheet.rect(left, y, right - left, down, stroke=SOFT)
    sheet.text(right + 1.2, y + 2.9, high, size=size)
