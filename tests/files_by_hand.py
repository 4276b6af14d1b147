"""Small files of every kind, written out by hand, for tests that then spoil one thing in them."""

from __future__ import annotations

import json
from pathlib import Path

from etd.files.pattern import Pattern, PatternFrame

REPOSITORY = Path(__file__).resolve().parents[1]
CONFIG = REPOSITORY / "config"
#: Real files of another kit; they lie beside the checkout and do not travel with it.
ETACTILEKIT_DATA = REPOSITORY.parent / "shared" / "data" / "etactilekit"

ARRAY = """\
name = "strip-3"
title = "three in a row"
view = "through-finger"
mark = "left end"
diameter_mm = 1.0
electrode = [
    { x_mm = -2.0, y_mm = 0.0 },
    { x_mm = 0.0, y_mm = 0.0 },
    { x_mm = 2.0, y_mm = 0.0, output = 7 },
]
"""

CALIBRATION = """\
participant = "P01"
body_site = "fingertip"
array = "strip-3"
polarity = "anodic"
width_us = 100
rate_hz = 60.0
returns = "all"
date = 2025-01-15
program = "etd 0.1.0"
electrode = [
    { threshold_ua = 1000, comfortable_ua = 2000, cap_ua = 3000, resistance_ohm = 50000 },
    { threshold_ua = 900, comfortable_ua = 1800, cap_ua = 3000 },
    { threshold_ua = 1100, comfortable_ua = 2200, cap_ua = 3000 },
]
"""

DAEMON = """\
backend = "fake"
board = "kajimoto-hv507"
machine = "pi4"
array = "grid-8x8"
body_site = "fingertip"
accept_absent_guards = []
operators = []

[engine]
core = "any"
priority = "none"
"""

PATTERN = """\
{"etd_pattern": 1, "electrodes": 3, "frames": [
    {"duration_ms": 30, "active": [0, 2]},
    {"duration_ms": 40, "off_ms": 5, "level": [0.0, 0.5, 1.0], "rate_hz": 50,
     "polarity": "cathodic"}
]}
"""

LAYOUT = {
    "outline": [],
    "electrodes": [{"x": -2, "y": 0}, {"x": 0, "y": 0}, {"x": 2, "y": 0}],
    "Mapping_func": [2, 0, 1],
    "electrode_radius": 0.75,
}


def kit_frame(pattern: list[int], **changes: object) -> list[dict[str, object]]:
    """One entry of eTactileKit's `Pattern_Data`."""
    frame: dict[str, object] = {
        "pattern": pattern,
        "delay": {"ON": 30, "OFF": 0},
        "params": {"frequency": 75, "stim_mode": 1},
    }
    return [frame | changes]


def kit_pattern(*frames: list[dict[str, object]]) -> str:
    return json.dumps({"Execution": True, "Simulation": True, "Pattern_Data": list(frames)})


def pattern_to_json(pattern: Pattern) -> str:
    """The file that `load_pattern` reads the same pattern from, one frame a line."""
    frames = ",\n".join(f"    {json.dumps(_frame_in_file(frame))}" for frame in pattern.frames)
    return f'{{"etd_pattern": 1, "electrodes": {pattern.electrodes}, "frames": [\n{frames}\n]}}\n'


def _frame_in_file(frame: PatternFrame) -> dict[str, object]:
    content: dict[str, object] = {"duration_ms": frame.duration_ms}
    if frame.off_ms:
        content["off_ms"] = frame.off_ms
    if set(frame.level) <= {0.0, 1.0}:
        content["active"] = frame.active
    else:
        content["level"] = frame.level
    if frame.rate_hz is not None:
        content["rate_hz"] = frame.rate_hz
    if frame.polarity is not None:
        content["polarity"] = frame.polarity
    return content


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def spoiled(text: str, old: str, new: str) -> str:
    """`text` with one thing changed; the test is wrong if it was not there."""
    assert text.count(old) >= 1, f"{old!r} is not in the file"
    return text.replace(old, new, 1)
