"""Errors as they cross processes: a pool of workers, a study program's children."""

from __future__ import annotations

import copy
import pickle

import pytest

from etd.protocol.errors import PatternError, Refused
from etd_hal.errors import BusError, EtdError, FileError, HardwareMissing

ERRORS = [
    BusError("busy", "/dev/spidev0.0", "open", "somebody has it"),
    FileError("board.toml", "maxima", "7", "at most 5"),
    HardwareMissing(("no chip", "no pins")),
    Refused("over_maximum", "too much", 7),
    PatternError("wave.json", None, "empty"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda entry: type(entry).__name__)
def test_an_error_arrives_in_another_process_with_its_fields(error: EtdError) -> None:
    for arrived in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(arrived) is type(error)
        assert str(arrived) == str(error)
        assert vars(arrived) == vars(error)
