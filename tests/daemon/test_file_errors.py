"""Every key of every kind of file, made wrong: the sentence names file and key, and teaches."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from etd.files.array import Array
from etd.files.body_site import BodySite
from etd.files.check import check_file
from etd.files.configuration import EtdConfig
from etd.protocol.calibration import Calibration
from etd_hal.boardfile import BoardFile, MachineFile
from etd_hal.errors import FileError
from etd_hal.tomlfile import convert
from files_by_hand import ARRAY, CALIBRATION, CONFIG, spoiled, write

SITE = (CONFIG / "bodysites" / "fingertip.toml").read_text(encoding="utf-8")
STABILIZED = """
[stabilize]
order = ["contact", "pressure", "linear_law", "strength_duration", "prepulse"]
probe_first = true
[stabilize.contact]
start_fraction = 0.5
[stabilize.pressure]
none_kpa = 10.0
[stabilize.linear_law]
max_widening = 1.5
[stabilize.strength_duration]
width_us = 50
tau_us = 150.0
[stabilize.prepulse]
below_db = 6.0
width_us = 40
[stabilize.bursts]
pulses = 2
rate_hz = 350.0
"""
KINDS: dict[str, tuple[type[msgspec.Struct], str]] = {
    "board": (BoardFile, (CONFIG / "boards" / "reference-hv507.toml").read_text(encoding="utf-8")),
    "machine": (MachineFile, (CONFIG / "machines" / "pi4.toml").read_text(encoding="utf-8")),
    "array": (Array, ARRAY),
    "body site": (BodySite, SITE + STABILIZED),
    "calibration": (Calibration, CALIBRATION),
    "configuration": (EtdConfig, (CONFIG / "etd.toml").read_text(encoding="utf-8")),
}


def leaves(data: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Of each value: its path, what holds it, and its key in that."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for part, value in items:
        where = f"{key}[{part}]" if isinstance(data, list) else f"{key}.{part}".lstrip(".")
        if isinstance(value, dict | list):
            yield from leaves(value, where)
        yield where, data, part


@pytest.mark.parametrize("kind", KINDS)
def test_any_value_of_another_kind_is_told_with_what_is_allowed_there(kind: str) -> None:
    struct, text = KINDS[kind]
    data = tomllib.loads(text)
    convert(data, struct, "a.toml")
    seen = 0
    for key, holder, part in leaves(data):
        right = holder[part]
        # None of ours is a number with a point below zero in a place for text, nor text that says
        # no such word in a place for anything else.
        holder[part] = -7.5 if isinstance(right, str) else "no such word"
        with pytest.raises(FileError) as told:
            convert(data, struct, "a.toml")
        assert (told.value.file, told.value.key) == ("a.toml", key)
        assert told.value.value == f"it says {holder[part]!r}"
        assert told.value.allowed.startswith("give "), told.value.allowed
        assert "Expected" not in told.value.allowed
        assert "Invalid" not in told.value.allowed
        holder[part] = right
        seen += 1
    assert seen > 8


@pytest.mark.parametrize(
    ("text", "old", "new", "sentence"),
    [
        (SITE + STABILIZED, '"pressure"', '"preasure"',
         'stabilize.order[1]: it says \'preasure\'; give "contact", "energy", "linear_law",'
         ' "power_law", "prepulse", "pressure" or "strength_duration" (is pressure meant?)'),
        (SITE, 'polarity = "anodic"', 'polarity = "both"',
         "defaults.polarity: it says 'both'; give \"anodic\", \"biphasic\","
         ' "biphasic_cathodic_first" or "cathodic"'),
        (CALIBRATION, "date = 2025-01-15", 'date = "yesterday"',
         "date: it says 'yesterday'; give a date such as 2025-01-15"),
        (CALIBRATION, 'polarity = "anodic"', 'polarity = "both"',
         "polarity: it says 'both'; give \"anodic\""),
        (CALIBRATION, 'returns = "all"', 'returns = "none"',
         "returns: it says 'none'; give \"all\", a table of ring_mm or a list"),
        (ARRAY, 'view = "through-finger"', 'view = "from above"',
         "view: it says 'from above'; give \"through-finger\""),
        (KINDS["board"][1], 'chip = "HV507"', 'chip = "HV508"',
         'switch.chip: it says \'HV508\'; give "HV507", "HV513" or "74HC595" (is HV507 meant?)'),
        (KINDS["machine"][1], "visit_us = 180.0", "visit = 60.0",
         "remove it, or correct its name (is visit_us meant?)"),
    ],
    ids=["law", "site", "date", "calibration", "returns", "view", "chip", "machine"],
)  # fmt: skip
def test_etd_check_names_what_may_be_chosen(
    tmp_path: Path, text: str, old: str, new: str, sentence: str
) -> None:
    path = write(tmp_path, "a.toml", spoiled(text, old, new))
    assert sentence in (check_file(path).error or "")
    assert str(path) in (check_file(path).error or "")
