"""Layout and pattern files of eTactileKit, as they are found in circulation.

Owns: what their keys mean, what can be mended in them, and what is refused, by file, frame and
reason. Must not know: boards, the player, the serial protocol of that kit.

Coordinates are taken as they stand: mm, y upwards, seen onto the electrodes. `Mapping_func` is
read as their firmware does: hardware[Mapping_func[i]] = pattern[i], so electrode i hangs on
output Mapping_func[i]. Values the kit ignores are named, not used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from etd.files.array import Array, Mm, check_array
from etd.files.json_file import read_json
from etd.protocol.errors import PatternError
from etd.protocol.frame import MAX_ELECTRODES
from etd_hal.errors import FileError
from etd_hal.tomlfile import convert

#: Smaller than in any layout of the kit (0.75 to 1.2 mm); a small electrode is the strict case.
ASSUMED_RADIUS_MM = 0.5
#: A layout does not say it, and the wrong one mirrors every picture.
UNKNOWN_MARK = "not stated in the layout file: find electrode 0 on the thing itself"

Radius = Annotated[float, Meta(gt=0, le=50)]


class _Point(msgspec.Struct, frozen=True):
    x: Mm
    y: Mm
    z: Mm = 0.0
    radius: Radius | None = None


class _Layout(msgspec.Struct, frozen=True):
    electrodes: Annotated[list[_Point], Meta(min_length=2, max_length=MAX_ELECTRODES)]
    mapping: list[Annotated[int, Meta(ge=0, lt=MAX_ELECTRODES)]] | None = msgspec.field(
        default=None, name="Mapping_func"
    )
    radius: Radius | None = msgspec.field(default=None, name="electrode_radius")
    count: int | None = msgspec.field(default=None, name="Electrodes_Number")


class _Delay(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    on_ms: int = msgspec.field(name="ON")
    off_ms: int = msgspec.field(name="OFF")


class _Params(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    frequency: float
    stim_mode: Literal[0, 1]


class _PatternFrame(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pattern: Annotated[list[Literal[0, 1]], Meta(min_length=1, max_length=MAX_ELECTRODES)]
    delay: _Delay
    params: _Params


def is_layout(data: object) -> bool:
    """Whether the content of a JSON file looks like a layout of the kit."""
    return isinstance(data, dict) and isinstance(data.get("electrodes"), list)


def is_pattern(data: object) -> bool:
    """Whether the content of a JSON file looks like a pattern of the kit."""
    return isinstance(data, dict) and "Pattern_Data" in data


def read_layout(path: Path) -> tuple[Array, tuple[str, ...]]:
    """A layout as an array, and a sentence for each thing mended or assumed. Raises: FileError."""
    data, mended = read_json(path)
    array, assumed = layout_to_array(data, path)
    return array, mended + assumed


def layout_to_array(data: object, path: Path) -> tuple[Array, tuple[str, ...]]:
    """As `read_layout`, from content already read. Raises: FileError."""
    layout = convert(data, _Layout, str(path))
    assumed: list[str] = []
    outputs = _outputs(layout, str(path), assumed)
    array = {
        "name": _name(path),
        "title": f"eTactileKit layout of {len(layout.electrodes)} electrodes",
        "view": "through-finger",
        "mark": UNKNOWN_MARK,
        "diameter_mm": 2 * _radius_mm(layout, assumed),
        "electrode": [
            {"x_mm": point.x, "y_mm": point.y, "output": output}
            for point, output in zip(layout.electrodes, outputs, strict=True)
        ],
    }
    if any(point.z != 0.0 for point in layout.electrodes):
        assumed.append("z was left out: distances are taken in the plane of x and y")
    if layout.count not in (None, len(layout.electrodes)):
        assumed.append(
            f"Electrodes_Number says {layout.count}, the list has {len(layout.electrodes)}:"
            " the list was taken"
        )
    return check_array(convert(array, Array, str(path)), str(path)), tuple(assumed)


def _outputs(layout: _Layout, file: str, assumed: list[str]) -> list[int]:
    count, mapping = len(layout.electrodes), layout.mapping
    if mapping is None:
        assumed.append("Mapping_func is missing: electrode i was taken to be on output i")
        return list(range(count))
    if len(mapping) < count:
        raise FileError(
            file,
            "Mapping_func",
            f"it has {len(mapping)} entries for {count} electrodes",
            "give the output of each electrode: nobody else can know it",
        )
    if len(mapping) > count:
        assumed.append(
            f"Mapping_func has {len(mapping)} entries for {count} electrodes: those beyond belong"
            " to no electrode and were left out"
        )
    return mapping[:count]


def _radius_mm(layout: _Layout, assumed: list[str]) -> float:
    radii_mm = [point.radius for point in layout.electrodes if point.radius is not None]
    if layout.radius is not None:
        return min([layout.radius, *radii_mm])
    if len(radii_mm) == len(layout.electrodes):
        if len(set(radii_mm)) > 1:
            assumed.append(f"radii differ: all were taken as the smallest, {min(radii_mm)} mm")
        return min(radii_mm)
    radius_mm = min([ASSUMED_RADIUS_MM, *radii_mm])
    assumed.append(
        f"electrode_radius is missing: it was taken as {radius_mm} mm, smaller than in any layout"
        " of the kit; measure yours and write it down"
    )
    return radius_mm


def _name(path: Path) -> str:
    kept = "".join(char if char.isascii() and char.isalnum() else "-" for char in path.stem)
    return f"etactilekit-{kept}"[:40]


def pattern_to_own(data: object, file: str) -> tuple[dict[str, object], tuple[str, ...]]:
    """A pattern of the kit as the content of a pattern file of ours, and what was left out.

    Pattern 1 is a pulse in each scan, stim_mode 1 anodic and 0 cathodic, delays in ms, frequency
    in Hz. Raises: PatternError, naming the frame.
    """
    entries = data.get("Pattern_Data") if isinstance(data, dict) else None
    if not isinstance(data, dict) or not isinstance(entries, list) or not entries:
        raise PatternError(file, None, "Pattern_Data is no list of frames: give at least one")
    frames = [_frame(entry, file, index) for index, entry in enumerate(entries)]
    count = len(frames[0].pattern)
    for index, frame in enumerate(frames):
        if len(frame.pattern) != count:
            raise PatternError(
                file,
                index,
                f"it has {len(frame.pattern)} values, those before it have {count}:"
                " all frames of a file are for one array",
            )
    own = {"etd_pattern": 1, "electrodes": count, "frames": [_own_frame(frame) for frame in frames]}
    return own, _left_out(data)


def _frame(entry: object, file: str, index: int) -> _PatternFrame:
    if not isinstance(entry, list) or len(entry) != 1:
        raise PatternError(file, index, "it is no list of one frame")
    try:
        return convert(entry[0], _PatternFrame, file)
    except FileError as error:
        where = f"{error.key}: " if error.key else ""
        raise PatternError(file, index, f"{where}{error.value}; {error.allowed}") from error


def _own_frame(frame: _PatternFrame) -> dict[str, object]:
    return {
        "duration_ms": frame.delay.on_ms,
        "off_ms": frame.delay.off_ms,
        "active": [index for index, on in enumerate(frame.pattern) if on],
        "rate_hz": frame.params.frequency,
        "polarity": "anodic" if frame.params.stim_mode == 1 else "cathodic",
    }


def _left_out(data: dict[str, object]) -> tuple[str, ...]:
    known = ("Pattern_Data", "Execution", "Simulation")
    return tuple(
        f"{key} was left out: frames carry their own values" for key in data if key not in known
    )
