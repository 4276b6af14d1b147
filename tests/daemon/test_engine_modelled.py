"""What a model answered for is played on a fake board alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Literal

import pytest

from engine_rig import EngineRig
from engine_scenes import calibration
from etd.calibrate.conditions import check_date
from etd.protocol.errors import Refused
from etd_hal.backend import Backend

MakeRig = Callable[..., EngineRig]
N = 16


@pytest.mark.parametrize(("name", "is_refused"), [("fake", False), ("linux", True)])
def test_a_calibration_that_no_person_felt_opens_no_lease_on_a_real_board(
    make_rig: MakeRig, name: Literal["linux", "fake"], is_refused: bool
) -> None:
    def named(backend: Backend) -> Backend:
        return dataclasses.replace(backend, name=name)

    rig = make_rig(electrodes=N, wrap=named)
    felt = calibration(rig, (3_000,) * N)
    modelled = calibration(rig, (3_000,) * N, modelled=True)
    answer = rig.open_with(modelled)
    if is_refused:
        assert answer.error == "bad_calibration"
        assert "no person felt it (modelled = true)" in answer.reason
        answer = rig.open_with(felt)
    assert answer.error is None


def test_nothing_is_added_to_a_calibration_of_a_day_to_come(make_rig: MakeRig) -> None:
    made = calibration(make_rig(electrodes=N), (3_000,) * N)
    check_date(made, made.date)
    with pytest.raises(Refused, match="set its clock") as refused:
        check_date(made, made.date.replace(year=made.date.year - 1))
    assert refused.value.code == "bad_calibration"
