"""A person's calibration as a file: loader and writer.

Owns: the file's form (TOML). Must not know: what its figures mean (`protocol/calibration.py`).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec

from etd.protocol.calibration import Calibration, ElectrodeLimits, check_order
from etd.protocol.frame import Returns, Ring
from etd.stabilize.shape import PLAIN
from etd_hal.tomlfile import load_toml


def load_calibration(path: Path) -> Calibration:
    """Read and check a calibration file. Raises: FileError."""
    return check_order(load_toml(path, Calibration), str(path))


def to_toml(calibration: Calibration) -> str:
    """The file that `load_calibration` reads the same calibration from, an electrode a line."""
    keys = {
        "participant": _text(calibration.participant),
        "body_site": _text(calibration.body_site),
        "array": _text(calibration.array),
        "polarity": _text(calibration.polarity),
        "width_us": str(calibration.width_us),
        "rate_hz": repr(float(calibration.rate_hz)),
        "returns": _returns(calibration.returns),
        "date": calibration.date.isoformat(),
        "program": _text(calibration.program),
        "gamma": repr(float(calibration.gamma)),
    }
    if calibration.method is not None:
        keys["method"] = _text(calibration.method)
    if calibration.pulses is not None:
        keys["pulses"] = str(calibration.pulses)
    if calibration.shape != PLAIN:
        keys["shape"] = _table(msgspec.to_builtins(calibration.shape))
    head = "".join(f"{key} = {value}\n" for key, value in keys.items())
    body = "".join(f"    {_electrode(limits)},\n" for limits in calibration.electrode)
    return f"{head}\nelectrode = [\n{body}]\n"


def _text(value: str) -> str:
    # JSON's escapes are TOML's, but for DEL, which only TOML forbids.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _returns(returns: Returns) -> str:
    if isinstance(returns, str):
        return _text(returns)
    if isinstance(returns, Ring):
        return f"{{ ring_mm = {float(returns.ring_mm)!r} }}"
    return json.dumps(returns)


def _table(values: dict[str, Any]) -> str:
    """Numbers and truths, and tables of them, on one line."""
    each = (
        f"{key} = {_table(value) if isinstance(value, dict) else json.dumps(value)}"
        for key, value in values.items()
    )
    return "{ " + ", ".join(each) + " }"


def _electrode(limits: ElectrodeLimits) -> str:
    keys = {key: str(getattr(limits, key)) for key in ("threshold_ua", "comfortable_ua", "cap_ua")}
    if limits.resistance_ohm is not None:
        keys["resistance_ohm"] = str(limits.resistance_ohm)
    if not limits.felt:
        keys["felt"] = "false"
    if limits.date is not None:
        keys["date"] = limits.date.isoformat()
    if limits.threshold_date is not None:
        keys["threshold_date"] = limits.threshold_date.isoformat()
    return "{ " + ", ".join(f"{key} = {value}" for key, value in keys.items()) + " }"
