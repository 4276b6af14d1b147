"""The electrodes by their places: grid, distances, and levels given by place.

Owns: what a program wants of an array's geometry. Must not know: sockets, frames, limits.

Rows are counted from the fingertip down, columns from the left, both from 0, as one looks through
the finger onto the electrodes; an array of numbers then looks like the display.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

from etd.client.values import ArrayLike, Numbers
from etd.protocol.errors import Refused
from etd.protocol.facts import ArrayFacts


class ElectrodeArray:
    """`x_mm` to the right, `y_mm` towards the fingertip, one for each electrode."""

    def __init__(self, facts: ArrayFacts) -> None:
        self.name = facts.name
        self.electrodes = facts.electrodes
        self.x_mm = facts.x_mm
        self.y_mm = facts.y_mm
        rows = {y_mm: row for row, y_mm in enumerate(sorted(set(facts.y_mm), reverse=True))}
        columns = {x_mm: column for column, x_mm in enumerate(sorted(set(facts.x_mm)))}
        places = [(rows[y], columns[x]) for x, y in zip(facts.x_mm, facts.y_mm, strict=True)]
        is_grid = len(rows) * len(columns) == len(set(places)) == facts.electrodes
        self._places = places if is_grid else []
        self._at = {place: electrode for electrode, place in enumerate(self._places)}
        #: (rows, columns); None where the electrodes form no grid.
        self.shape = (len(rows), len(columns)) if is_grid else None

    def at(self, row: int, column: int) -> int:
        """The electrode there. Raises: Refused (`bad_frame`)."""
        shape = self._grid()
        if (row, column) not in self._at:
            raise Refused(
                "bad_frame",
                f"there is no electrode in row {row}, column {column}: {self.name} has rows 0 to"
                f" {shape[0] - 1} and columns 0 to {shape[1] - 1}",
            )
        return self._at[row, column]

    def place(self, electrode: int) -> tuple[int, int]:
        """Its row and column. Raises: Refused (`bad_frame`)."""
        self._grid()
        self._check(electrode)
        return self._places[electrode]

    def nearest(self, x_mm: float, y_mm: float) -> int:
        """The electrode nearest to that place; of several the one with the lowest number. Raises:
        Refused (`bad_frame`) for what is no finite number.
        """
        for key, value in (("x_mm", x_mm), ("y_mm", y_mm)):
            if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
                raise Refused("bad_frame", f"{key}={value!r:.40}: a finite number is needed")
        places = zip(self.x_mm, self.y_mm, strict=True)
        distances = [math.hypot(x - x_mm, y - y_mm) for x, y in places]
        return distances.index(min(distances))

    def distance_mm(self, one: int, other: int) -> float:
        """Between their centres. Raises: Refused (`bad_frame`)."""
        self._check(one)
        self._check(other)
        return math.hypot(self.x_mm[one] - self.x_mm[other], self.y_mm[one] - self.y_mm[other])

    def by_electrode(self, numbers: Numbers | Mapping[int, float]) -> Numbers:
        """One number for each electrode, from `{electrode: number}` (the others are 0), or from
        rows of numbers shaped as the grid; a plain sequence as it is.

        Raises: Refused (`bad_frame`).
        """
        if isinstance(numbers, Mapping):
            return self._of_mapping(numbers)
        rows: Any = numbers.tolist() if isinstance(numbers, ArrayLike) else numbers
        if isinstance(rows, (list, tuple)):
            rows = [
                row.tolist() if isinstance(row, ArrayLike) and _has_length(row) else row
                for row in rows
            ]
        if isinstance(rows, Sequence) and rows and _is_row(rows[0]):
            return self._of_rows(rows)
        return rows if isinstance(rows, (list, tuple)) else numbers

    def _of_mapping(self, numbers: Mapping[int, float]) -> list[float]:
        found: list[float] = [0] * self.electrodes
        for electrode, number in numbers.items():
            self._check(electrode)
            found[electrode] = number
        return found

    def _of_rows(self, rows: Sequence[Any]) -> list[float]:
        shape = self._grid()
        lengths = {len(row) if _is_row(row) else 0 for row in rows}
        if len(rows) != shape[0] or lengths != {shape[1]}:
            raise Refused(
                "bad_frame",
                f"{len(rows)} rows of {'/'.join(map(str, sorted(lengths)))} numbers: {self.name}"
                f" has {shape[0]} rows of {shape[1]}; or give one number for each electrode",
            )
        return [rows[row][column] for row, column in self._places]

    def _grid(self) -> tuple[int, int]:
        if self.shape is None:
            raise Refused(
                "bad_frame",
                f"the electrodes of {self.name} form no grid: give one number for each, or a"
                " mapping {electrode: number}",
            )
        return self.shape

    def _check(self, electrode: object) -> None:
        # Numbers of numpy are electrodes too, and compare as such; True is one for Python alone.
        if isinstance(electrode, bool) or not hasattr(electrode, "__index__"):
            raise Refused("bad_frame", f"{electrode!r:.40} is no electrode: give its number")
        if not 0 <= electrode < self.electrodes:  # type: ignore[operator]
            raise Refused(
                "bad_frame", f"there is no electrode {electrode}: 0 to {self.electrodes - 1}"
            )


def _has_length(value: object) -> bool:
    """A number of numpy has `tolist` too."""
    return hasattr(value, "__len__")


def _is_row(value: object) -> bool:
    return isinstance(value, (list, tuple))
