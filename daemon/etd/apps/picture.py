"""An array of electrodes as rows of characters.

Owns: the conversion of positions in mm to rows and columns. Must not know: what is drawn there, the
terminal.

Rows run from the fingertip (largest y) down, columns from left to right; rows that are offset by
half a pitch (hexagons) are drawn so.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

#: Positions closer than this are in one row or column.
_SAME_MM = 0.05


class Picture:
    """`x_mm` and `y_mm` have a position for each electrode."""

    def __init__(self, x_mm: Sequence[float], y_mm: Sequence[float]) -> None:
        rows = _places([-y for y in y_mm], _step(y_mm))
        columns = _places(list(x_mm), _pitch(x_mm, y_mm) / 2)
        self._cells = list(zip(rows, columns, strict=True))
        self._height = max(rows) + 1
        self._width = max(columns) + 1

    def cells(self) -> list[tuple[int, int]]:
        """(row, column) of each electrode."""
        return list(self._cells)

    def rows(self, signs: Sequence[str]) -> list[str]:
        """The rows, with one sign for each electrode and blanks between them."""
        grid = [[" "] * self._width for _ in range(self._height)]
        for (row, column), sign in zip(self._cells, signs, strict=True):
            grid[row][column] = sign
        return ["".join(row).rstrip() for row in grid]


def _places(values: Sequence[float], step: float) -> list[int]:
    least = min(values)
    return [round((value - least) / step) for value in values]


def _step(values: Sequence[float]) -> float:
    """The smallest distance between two that differ; 1 if none do."""
    different = sorted(set(values))
    gaps = [b - a for a, b in pairwise(different) if b - a > _SAME_MM]
    return min(gaps, default=1.0)


def _pitch(x_mm: Sequence[float], y_mm: Sequence[float]) -> float:
    """The smallest distance between neighbors in a row."""
    by_row: dict[int, list[float]] = {}
    step = _step(y_mm)
    for x, y in zip(x_mm, y_mm, strict=True):
        by_row.setdefault(round(y / step), []).append(x)
    gaps = [_step(row) for row in by_row.values() if len(row) > 1]
    return min(gaps, default=1.0)
