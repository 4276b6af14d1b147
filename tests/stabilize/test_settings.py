"""The `[stabilize]` table: what is refused, and what it makes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from engine_parts import board_file
from etd.files.body_site import load_body_site
from etd.files.configuration import load_config
from etd.files.resources import find
from etd.protocol.errors import FileError
from etd.stabilize.contact import Contact
from etd.stabilize.linear_law import LinearLaw
from etd.stabilize.pressure import Pressure
from etd.stabilize.settings import Settings, check_settings, pipeline


def settings(**tables: Any) -> Settings:
    return msgspec.convert({"order": list(tables), **tables}, Settings)


def test_the_laws_ask_in_the_order_of_the_file() -> None:
    made = pipeline(settings(pressure={}, linear_law={}, contact={}), board_file().source)
    assert [type(stabilizer) for stabilizer in made] == [Pressure, LinearLaw, Contact]


@pytest.mark.parametrize("name", ["fingertip", "forearm"])
def test_by_default_nothing_stabilizes(name: str) -> None:
    assert pipeline(load_body_site(find("bodysites", name)).stabilize, board_file().source) == ()


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        ({"energy": {}, "linear_law": {}}, "stabilize.order: it names energy and linear_law"),
        ({"power_law": {}, "energy": {}}, "it names power_law and energy"),
        ({"pressure": {"none_kpa": 50.0, "full_kpa": 50.0}}, "none_kpa 50.0 is not below"),
    ],
)
def test_what_does_not_go_together_is_refused(tables: dict[str, Any], sentence: str) -> None:
    with pytest.raises(FileError, match=sentence):
        check_settings(settings(**tables), "a.toml")


@pytest.mark.parametrize("name", ["contact", "pressure", "energy", "linear_law"])
def test_a_table_that_no_order_names_is_refused(name: str) -> None:
    with pytest.raises(FileError, match=f"stabilize.{name}"):
        check_settings(msgspec.convert({name: {}}, Settings), "a.toml")


def test_k_is_the_persons_and_no_site_has_one() -> None:
    with pytest.raises(msgspec.ValidationError, match="unknown field `k`"):
        settings(power_law={"k": 1.0})


SITE = find("bodysites", "fingertip").read_text()
ARRAY = find("arrays", "grid-8x8").read_text()
SENSOR = """
[[pressure]]
address = 0x48
channel = {channel}
x_mm = 0.0
y_mm = 0.0
zero_v = 0.5
kpa_per_v = 100.0
low_v = 0.2
high_v = 3.0
"""
DAEMON = """
backend = "fake"
board = "{board}"
machine = "pi4"
array = "./array.toml"
body_site = "./site.toml"
accept_absent_guards = []
operators = []
[engine]
core = "any"
priority = "none"
"""
BY_PRESSURE = '\n[stabilize]\norder = ["pressure"]\n[stabilize.pressure]\n'


def load(folder: Path, board: str, sensor: str) -> None:
    (folder / "site.toml").write_text(SITE + BY_PRESSURE)
    (folder / "array.toml").write_text(ARRAY + sensor)
    (folder / "etd.toml").write_text(DAEMON.format(board=board))
    load_config(folder / "etd.toml")


def test_pressure_goes_with_a_sensor_on_a_board_with_i2c(tmp_path: Path) -> None:
    load(tmp_path, "reference-hv507", SENSOR.format(channel=1))


@pytest.mark.parametrize(
    ("board", "sensor", "sentence"),
    [
        ("reference-hv507", "", "goes by pressure, grid-8x8 has no sensor"),
        ("kajimoto-hv507", SENSOR.format(channel=1), "has no I2C"),
        ("reference-hv507", SENSOR.format(channel=0), "watches the rail"),
        ("reference-hv507", SENSOR.format(channel=1) * 2, "sensor 0 is on channel 1"),
        ("reference-hv507", SENSOR.format(channel=1).replace("0.5", "3.5"), "they must rise"),
    ],
)
def test_pressure_without_what_it_needs_is_refused(
    tmp_path: Path, board: str, sensor: str, sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence):
        load(tmp_path, board, sensor)
