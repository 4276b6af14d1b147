"""Shipped board and machine files as text, to be spoiled, and how a refusal of one is asserted.

Owns: the texts, and that a refusal has file, key, value and what is allowed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from board_rig import MACHINES
from etd_hal.errors import FileError
from files_by_hand import write
from stepped_board import BOARDS

REFERENCE = (BOARDS / "reference-hv507.toml").read_text("utf-8")
KIT = (BOARDS / "kajimoto-hv507.toml").read_text("utf-8")
RELAYS = (BOARDS / "feetthrough-relay.toml").read_text("utf-8")
HV513 = (BOARDS / "etactilekit-hv513.toml").read_text("utf-8")
PI4 = (MACHINES / "pi4.toml").read_text("utf-8")


def refused(
    load: Callable[[Path], object], folder: Path, text: str, key: str, *fragments: str
) -> FileError:
    """Refused at this key; the sentence has the file and all fragments."""
    path = write(folder, "spoiled.toml", text)
    with pytest.raises(FileError) as caught:
        load(path)
    assert caught.value.file == str(path)
    assert caught.value.key == key
    for fragment in (str(path), key, *fragments):
        assert fragment in str(caught.value)
    return caught.value
