"""What `etd measure` prints of what was found."""

from __future__ import annotations

import msgspec

from etd.cli.measure import lines_of
from etd.protocol.messages import MeasureReply
from etd.protocol.outcome import Withheld

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


def test_probes_that_were_withheld_have_their_limit_and_when_there_is_room() -> None:
    by_ledger = Withheld(electrode=1, reason="return charge", after_ms=940)
    lines = lines_of(msgspec.structs.replace(FOUND, withheld=(by_ledger,)))
    assert "no probe" not in lines[1]
    assert lines[2].endswith("no probe: the charge of a return in the last second")
    assert lines[3].endswith("left no room: measure again in 0.9 s")


def test_a_probe_that_a_cap_withholds_is_not_to_be_waited_for() -> None:
    by_cap = Withheld(electrode=1, reason="cap", after_ms=None)
    lines = lines_of(msgspec.structs.replace(FOUND, withheld=(by_cap,)))
    assert lines[2].endswith("no probe: its cap")
    assert len(lines) == 3
