"""Where the electrodes are, and which chain output each one hangs on.

Owns: the array file, its rules, and what follows from the geometry alone (distances, rings,
neighbors). Must not know: boards (beyond how many outputs there are), currents, people.

Coordinates: mm, x to the right, y towards the fingertip, seen through the finger onto the
electrodes. A ring of returns is the concentric electrode of Kajimoto, Electro-tactile Display,
section 2 (Figure 4), made of the electrodes that lie at about that radius.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from etd.protocol.frame import MAX_ELECTRODES
from etd_hal.errors import FileError
from etd_hal.names import whole
from etd_hal.tomlfile import load_toml

#: Beyond this no array reaches; the bounds also keep NaN out, as all bounds on numbers here do.
Mm = Annotated[float, Meta(ge=-500.0, le=500.0)]
#: Metal that is nearer is one electrode: no file may say that one is smaller than this.
LEAST_PITCH_MM = 0.1
#: A ring's members lie within this fraction of its radius from the circle.
RING_TOLERANCE = 0.25

#: The array that a pattern of so many electrodes is shown on when nobody named one.
ARRAY_FOR_COUNT = {
    8: "pad-8",
    16: "grid-4x4",
    32: "grid-4x8",
    60: "grid-5x12",
    61: "hexagon-61",
    64: "grid-8x8",
    256: "grid-16x16",
}


class Electrode(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One electrode. `output` is its output in the switch chain; its own index if left out."""

    x_mm: Mm
    y_mm: Mm
    output: Annotated[int, Meta(ge=0, lt=MAX_ELECTRODES)] | None = None


class PressureSensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One sensor under the array, on an ADS1115: kPa = (volts - zero_v) x kpa_per_v.

    What is not within `low_v` to `high_v` comes from no sensor: a broken wire, a short.
    """

    address: Annotated[int, Meta(ge=0x48, le=0x4B)]
    channel: Annotated[int, Meta(ge=0, le=3)]
    x_mm: Mm
    y_mm: Mm
    zero_v: Annotated[float, Meta(ge=0.0, le=4.0)]
    kpa_per_v: Annotated[float, Meta(gt=0.0, le=100_000.0)]
    low_v: Annotated[float, Meta(ge=-0.1, le=4.0)]
    high_v: Annotated[float, Meta(ge=0.0, le=4.0)]


class Array(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An array of electrodes; the place in `electrode` is the electrode's index everywhere."""

    name: Annotated[str, Meta(pattern=whole("[A-Za-z0-9][A-Za-z0-9_-]{0,39}"))]
    title: str
    view: Literal["through-finger"]
    #: How to find electrode 0 on the thing itself.
    mark: Annotated[str, Meta(min_length=1)]
    diameter_mm: Annotated[float, Meta(ge=LEAST_PITCH_MM, le=100.0)]
    electrode: Annotated[tuple[Electrode, ...], Meta(min_length=2, max_length=MAX_ELECTRODES)]
    #: Under the array; each electrode goes by the nearest one.
    pressure: Annotated[tuple[PressureSensor, ...], Meta(max_length=16)] = ()

    @property
    def count(self) -> int:
        return len(self.electrode)

    @property
    def x_mm(self) -> tuple[float, ...]:
        return tuple(electrode.x_mm for electrode in self.electrode)

    @property
    def y_mm(self) -> tuple[float, ...]:
        return tuple(electrode.y_mm for electrode in self.electrode)

    def outputs(self) -> tuple[int, ...]:
        """The chain output of each electrode, in the order of the electrodes."""
        return tuple(
            index if electrode.output is None else electrode.output
            for index, electrode in enumerate(self.electrode)
        )

    def distance_mm(self, a: int, b: int) -> float:
        """Between the centers of two electrodes."""
        electrode, other = self.electrode[a], self.electrode[b]
        return math.hypot(electrode.x_mm - other.x_mm, electrode.y_mm - other.y_mm)

    def pitch_mm(self) -> float:
        """The smallest distance between two electrodes."""
        return min(self.distance_mm(a, b) for a in range(self.count) for b in range(a))

    def ring(self, electrode: int, ring_mm: float) -> tuple[int, ...]:
        """The electrodes within a quarter of `ring_mm` from the circle of that radius; may be
        empty. The electrode itself, at distance 0, is never among them.
        """
        slack_mm = RING_TOLERANCE * ring_mm
        return tuple(
            other
            for other in range(self.count)
            if abs(self.distance_mm(electrode, other) - ring_mm) <= slack_mm
        )

    def nearest_pressure(self, electrode: int) -> int | None:
        """Which sensor lies nearest to it; None where there is none."""
        place = self.electrode[electrode]
        return min(
            range(len(self.pressure)),
            key=lambda it: math.hypot(
                place.x_mm - self.pressure[it].x_mm, place.y_mm - self.pressure[it].y_mm
            ),
            default=None,
        )

    def neighbors(self, electrode: int) -> tuple[int, ...]:
        """The electrodes around it, one pitch away (on a square grid without the diagonals)."""
        return self.ring(electrode, self.pitch_mm())


def array_for_count(electrodes: int) -> str:
    """The name of the shipped array of so many electrodes. Raises: FileError."""
    if electrodes not in ARRAY_FOR_COUNT:
        known = ", ".join(str(count) for count in ARRAY_FOR_COUNT)
        raise FileError(
            "array",
            "electrodes",
            f"no shipped array has {electrodes} electrodes",
            f"name an array file with --array, or use one of {known} electrodes",
        )
    return ARRAY_FOR_COUNT[electrodes]


def load_array(path: Path) -> Array:
    """Read and check an array file. Raises: FileError."""
    return check_array(load_toml(path, Array), str(path))


def check_array(array: Array, file: str) -> Array:
    """The rules that no type expresses. Raises: FileError."""
    _check_places(array, file)
    _check_outputs(array, file)
    _check_sensors(array, file)
    return array


def check_fits(array: Array, outputs: int, file: str) -> None:
    """Every electrode must have an output on the board. Raises: FileError."""
    for index, output in enumerate(array.outputs()):
        if output >= outputs:
            raise FileError(
                file,
                f"electrode[{index}].output",
                f"it hangs on output {output}, the board has {outputs} (0 to {outputs - 1})",
                "name a board with more outputs, or an array that fits this one",
            )


def _check_places(array: Array, file: str) -> None:
    for index, electrode in enumerate(array.electrode):
        for other in range(index):
            apart_mm = array.distance_mm(index, other)
            if apart_mm >= LEAST_PITCH_MM:
                continue
            where = f"where electrode {other} is ({electrode.x_mm} mm, {electrode.y_mm} mm)"
            if apart_mm:
                where = f"{apart_mm:.2g} mm from electrode {other}"
            raise FileError(
                file,
                f"electrode[{index}]",
                f"it is {where}",
                f"give each electrode a place of its own, at least {LEAST_PITCH_MM} mm from others",
            )


def _check_outputs(array: Array, file: str) -> None:
    seen: dict[int, int] = {}
    for index, output in enumerate(array.outputs()):
        if output in seen:
            raise FileError(
                file,
                f"electrode[{index}].output",
                f"output {output} belongs to electrode {seen[output]} as well",
                "give each electrode an output of its own: their limits would add up on one wire",
            )
        seen[output] = index


def _check_sensors(array: Array, file: str) -> None:
    seen: dict[tuple[int, int], int] = {}
    for index, sensor in enumerate(array.pressure):
        if not sensor.low_v <= sensor.zero_v < sensor.high_v:
            raise FileError(
                file,
                f"pressure[{index}]",
                f"low_v, zero_v, high_v are {sensor.low_v}, {sensor.zero_v}, {sensor.high_v}",
                "they must rise: outside of low_v to high_v there is no sensor",
            )
        place = (sensor.address, sensor.channel)
        if place in seen:
            raise FileError(
                file,
                f"pressure[{index}]",
                f"sensor {seen[place]} is on channel {sensor.channel} of 0x{sensor.address:02x} as"
                " well",
                "give each sensor an input of its own",
            )
        seen[place] = index
