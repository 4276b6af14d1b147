"""What `etd measure` prints of what was found."""

from __future__ import annotations

import msgspec

from etd.cli.measure import lines_of
from etd.protocol.messages import MeasureReply

FOUND = MeasureReply(
    ok=True,
    now_ns=0,
    id=1,
    contact=(True, None),
    resistance_ohm=(52_258, None),
    voltage_v=(8.7, None),
)


def test_pressure_has_a_column_where_there_are_sensors() -> None:
    pressed = msgspec.structs.replace(FOUND, pressure_kpa=(40.2, None))
    assert [line.endswith(" kPa") for line in lines_of(pressed)] == [False, True, True]
    assert "    40 kPa" in lines_of(pressed)[1]
    assert "     ? kPa" in lines_of(pressed)[2]


def test_without_sensors_there_is_no_such_column() -> None:
    assert not any("kPa" in line for line in lines_of(FOUND))
