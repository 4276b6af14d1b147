"""An engine that starts beside something busy: a few attempts at its timing, each told."""

from __future__ import annotations

import pytest

from engine_rig import EngineRig, make
from etd.protocol.errors import BoardFault, BusError
from etd_hal.fake.faults import Fault, SpiError, SpiJitter, SpiStall

#: Messages of the first attempt: one in each of its rounds.
DISTURBED: list[Fault] = [SpiStall(300 + 9 * at, at_message=1 + 16 * at) for at in range(1, 28)]


def begun(faults: list[Fault]) -> tuple[EngineRig, list[str]]:
    told: list[str] = []
    return make(faults=faults, tell=told.append), told


def test_one_disturbed_calibration_is_repeated_and_told() -> None:
    rig, told = begun(DISTURBED)
    assert len(told) == 1
    assert told[0].startswith("attempt 1 of 3: timing calibration, ")
    assert " us" in told[0]
    assert rig.engine.supervisor.limitations == tuple(told)
    assert rig.engine.components.reporter.counters["calibration_attempts_failed"] == 1
    rig.open()
    rig.arm()
    assert rig.state == "ARMED"
    assert rig.close() == ()


def test_an_undisturbed_one_says_nothing() -> None:
    rig, told = begun([])
    assert told == []
    assert rig.engine.supervisor.limitations == ()
    assert "calibration_attempts_failed" not in rig.engine.components.reporter.counters
    assert rig.close() == ()


def test_what_is_really_wrong_fails_three_times_and_ends_it() -> None:
    told: list[str] = []
    with pytest.raises(BoardFault, match="timing calibration"):
        make(faults=[SpiJitter(3, 20)], tell=told.append)
    assert [text[:14] for text in told] == [f"attempt {electrode} of 3" for electrode in (1, 2, 3)]


def test_a_bus_that_fails_is_not_tried_again() -> None:
    told: list[str] = []
    with pytest.raises(BusError):
        make(faults=[SpiError(at_message=20)], tell=told.append)
    assert told == []
