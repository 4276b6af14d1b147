"""How many calibrations and records a daemon keeps, and how large."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import pytest

from etd.files.calibration import load_calibration
from etd.files.calibration_folder import (
    MOST_CALIBRATIONS,
    MOST_FILE_BYTES,
    MOST_IN_ALL_BYTES,
    CalibrationFolder,
)
from etd.files.resources import find
from etd.gateway.record_store import RecordStore
from etd.protocol.errors import Refused
from etd.protocol.exponent import FittedExponent
from etd.protocol.frame import MAX_ELECTRODES

CALIBRATION = load_calibration(find("calibrations", "fake-fingertip"))


@pytest.fixture
def store(tmp_path: Path) -> CalibrationFolder:
    made = CalibrationFolder(tmp_path / "calibrations", None)
    made.put("p01", CALIBRATION)
    return made


def refused(store: CalibrationFolder) -> str:
    with pytest.raises(Refused) as told:
        store.put("one-more", CALIBRATION)
    assert told.value.code == "bad_calibration"
    assert "etd calibration delete" in told.value.reason
    return told.value.reason


def test_no_more_than_so_many_are_kept_and_one_that_is_there_can_be_replaced(
    store: CalibrationFolder, tmp_path: Path
) -> None:
    for number in range(MOST_CALIBRATIONS - 2):
        (tmp_path / "calibrations" / f"q{number}.toml").touch()
    store.put("last", CALIBRATION)
    assert str(MOST_CALIBRATIONS) in refused(store)
    store.put("p01", CALIBRATION)
    store.put("last", CALIBRATION)
    store.delete("last")
    store.put("one-more", CALIBRATION)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"gamma": 99.0}, "gamma: it says 99"),
        ({"false_alarm_rate": math.nan}, "false_alarm_rate: it says nan"),
        ({"participant": "Anna Smith"}, "participant"),
        ({"rate_hz": math.inf}, "rate_hz: it says inf"),
    ],
)
def test_what_could_not_be_read_again_is_refused_and_the_one_that_is_there_stays(
    store: CalibrationFolder, tmp_path: Path, changes: dict[str, object], why: str
) -> None:
    """A program may build a calibration whose figures nothing has checked."""
    path = tmp_path / "calibrations" / "p01.toml"
    before = path.read_bytes()
    with pytest.raises(Refused, match=why) as told:
        store.put("p01", msgspec.structs.replace(CALIBRATION, **changes))
    assert told.value.code == "bad_calibration"
    assert path.read_bytes() == before
    assert load_calibration(path) == CALIBRATION


def test_a_k_that_is_not_known_is_kept_with_its_wide_interval(
    store: CalibrationFolder, tmp_path: Path
) -> None:
    wide = FittedExponent(
        k=1.51, low=-2.54, high=5.57, explained=0.6, electrodes=(0, 1, 2, 3), states=5, fold=2.3,
        date=CALIBRATION.date, board="kajimoto-hv507", leak_ohm=66_000,
    )  # fmt: skip
    made = msgspec.structs.replace(CALIBRATION, exponent=wide)
    store.put("p01", made)
    assert load_calibration(tmp_path / "calibrations" / "p01.toml") == made
    assert wide.why_not is not None
    endless = msgspec.structs.replace(wide, high=math.inf)
    with pytest.raises(Refused, match=r"exponent\.high: it says inf"):
        store.put("p01", msgspec.structs.replace(CALIBRATION, exponent=endless))


def test_nor_more_than_so_many_bytes(store: CalibrationFolder, tmp_path: Path) -> None:
    folder = tmp_path / "calibrations"
    own_bytes = (folder / "p01.toml").stat().st_size
    with (folder / "large.toml").open("wb") as file:
        file.truncate(MOST_IN_ALL_BYTES - own_bytes)
    assert "MB" in refused(store)
    store.put("p01", CALIBRATION)
    (folder / "large.toml").unlink()
    store.put("one-more", CALIBRATION)


def test_what_a_killed_daemon_left_over_counts_in_bytes(
    store: CalibrationFolder, tmp_path: Path
) -> None:
    with (tmp_path / "calibrations" / ".p01-x7").open("wb") as file:
        file.truncate(MOST_IN_ALL_BYTES)
    refused(store)


def test_no_calibration_makes_a_file_that_is_larger_than_the_engine_reads(
    store: CalibrationFolder,
) -> None:
    every = range(MAX_ELECTRODES)
    returns = tuple(tuple(other for other in every if other != own) for own in every)
    electrode = msgspec.structs.replace(
        CALIBRATION.electrode[0],
        resistance_ohm=1_000_000,
        date=CALIBRATION.date,
        threshold_date=CALIBRATION.date,
        quality="vibration",
        place="elsewhere",
    )
    large = msgspec.structs.replace(
        CALIBRATION, electrode=(electrode,) * MAX_ELECTRODES, returns=returns
    )
    store.put("large", large)
    assert store.find("large", with_shipped=False).stat().st_size < MOST_FILE_BYTES


def test_no_more_than_so_many_records_are_kept_however_short(tmp_path: Path) -> None:
    (tmp_path / "records").mkdir()
    for number in range(1_000):
        (tmp_path / "records" / f"r{number}.jsonl").touch()
    store = RecordStore(tmp_path)
    with pytest.raises(Refused, match="there are 1000 records") as told:
        store.create("one-more")
    assert told.value.code == "record_failed"
    store.delete("r7")
    file = store.create("one-more")
    file.close()
    file.wait_closed(10.0)
