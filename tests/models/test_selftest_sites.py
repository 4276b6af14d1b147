"""A self-test under every body site: where none can pass, nobody can be armed."""

from __future__ import annotations

import pytest

from etd.files.resources import names
from etd_hal.fake.faults import RailOff
from selftest_cases import ALL, BARE, RELAY
from selftest_rig import selftest_rig


@pytest.mark.parametrize("board", [ALL, BARE, RELAY])
@pytest.mark.parametrize("body_site", names("bodysites"))
def test_a_good_board_passes_under_every_shipped_body_site(board: str, body_site: str) -> None:
    report = selftest_rig(board, body_site=body_site).run()
    assert [check.name for check in report.checks if check.result in ("fail", "skip")] == []
    assert report.passed


@pytest.mark.parametrize("body_site", names("bodysites"))
def test_a_low_rail_is_found_under_every_shipped_body_site(body_site: str) -> None:
    report = selftest_rig(BARE, body_site=body_site, faults=[RailOff(0.8)]).run()
    assert [check.name for check in report.checks if check.result == "fail"] == ["compliance"]
