"""A person's calibration as a file: loader and writer.

Owns: the file's form (TOML). Must not know: what its figures mean (`protocol/calibration.py`).
"""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path

import msgspec

from etd.protocol.calibration import Calibration, check_order
from etd.stabilize.shape import PLAIN
from etd_hal.tomlfile import convert, load_bytes, load_toml


def load_calibration(path: Path) -> Calibration:
    """Read and check a calibration file. Raises: FileError."""
    return check_order(load_toml(path, Calibration), str(path))


def calibration_of_bytes(path: Path, data: bytes) -> Calibration:
    """As `load_calibration`, of the bytes that were read from `path`. Raises: FileError."""
    return check_order(load_bytes(path, Calibration, data), str(path))


def file_of(calibration: Calibration, name: str) -> bytes:
    """What is to be written, once it was read back: a program may have made the calibration, and
    nothing has looked at its figures. Raises: FileError, naming what no file may have.
    """
    convert(msgspec.to_builtins(calibration), Calibration, name)
    data = to_toml(calibration).encode()
    if sys.version_info >= (3, 11):  # Python reads TOML from there on
        calibration_of_bytes(Path(name), data)
    return data


def to_toml(calibration: Calibration) -> str:
    """The file that `load_calibration` reads the same calibration from, an electrode a line."""
    keys = msgspec.structs.asdict(calibration)
    electrodes = keys.pop("electrode")
    if calibration.shape == PLAIN:
        del keys["shape"]
    head = "".join(f"{key} = {_toml(value)}\n" for key, value in keys.items() if value is not None)
    body = "".join(f"    {_toml(limits)},\n" for limits in electrodes)
    return f"{head}\nelectrode = [\n{body}]\n"


def _toml(value: object) -> str:
    """On one line; of a table only what differs from its defaults."""
    if isinstance(value, datetime.date):
        return value.isoformat()
    if isinstance(value, msgspec.Struct):
        fields = [(field, getattr(value, field.name)) for field in msgspec.structs.fields(value)]
        said = [
            f"{field.name} = {_toml(given)}" for field, given in fields if given != field.default
        ]
        return f"{{ {', '.join(said)} }}"
    # JSON's escapes are TOML's, but for DEL, which only TOML forbids.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
