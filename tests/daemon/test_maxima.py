"""What nobody may get: the smallest of the ceilings of code, board file and body-site file."""

from __future__ import annotations

import msgspec
import pytest

from engine_parts import board_file, board_with, body_site, site_with
from etd.engine.capabilities import maxima_facts
from etd.files.body_site import SiteMaxima
from etd.safety.maxima import Maxima, MaximaInForce, maxima_of
from etd_hal import ceilings
from etd_hal.boardfile import BoardMaxima

#: By hand: whoever moves a ceiling moves it here as well.
CEILINGS = {
    "CURRENT_UA": 10_000,
    "WIDTH_US": 200,
    "CHARGE_NC": 2_000,
    "RATE_HZ": 200,
    "INTERVAL_US": 500,
    "MEAN_CURRENT_UA": 120,
    "ARRAY_MEAN_CURRENT_UA": 8_000,
    "ON_US_PER_S": 80_000,
    "ARRAY_ON_US_PER_S": 800_000,
    "NET_CHARGE_NC": 15_000,
    "PROBE_CURRENT_UA": 1_000,
    "PROBE_WIDTH_US": 50,
    "HALT_EXCESS_US": 1_000,
    "DRIFT_US": 50,
    "SPREAD_US": 200,
}


def test_the_hard_ceilings_are_these() -> None:
    found = {name: value for name, value in vars(ceilings).items() if name.isupper()}
    assert found == CEILINGS


def test_files_that_allow_all_get_the_ceilings_and_no_more() -> None:
    """Not by their loaders, which refuse them: whatever made these, no maximum is above."""
    most = dict.fromkeys(BoardMaxima.__struct_fields__, 10**9)
    board = msgspec.structs.replace(board_file(), maxima=BoardMaxima(**most))
    here = dict.fromkeys(SiteMaxima.__struct_fields__, 10**9) | {"interval_us": 1}
    site = msgspec.structs.replace(body_site(), maxima=SiteMaxima(**here))
    maxima = maxima_of(board, site)
    assert maxima.current_ua == maxima.uncalibrated_current_ua == CEILINGS["CURRENT_UA"]
    assert maxima.width_us == CEILINGS["WIDTH_US"]
    assert maxima.charge_pc == CEILINGS["CHARGE_NC"] * 1_000
    assert maxima.rate_hz == CEILINGS["RATE_HZ"]
    assert maxima.interval_us == CEILINGS["INTERVAL_US"]
    assert maxima.mean_current_ua == CEILINGS["MEAN_CURRENT_UA"]
    assert maxima.array_mean_current_ua == CEILINGS["ARRAY_MEAN_CURRENT_UA"]
    assert maxima.on_us_per_s == CEILINGS["ON_US_PER_S"]
    assert maxima.array_on_us_per_s == CEILINGS["ARRAY_ON_US_PER_S"]
    assert maxima.net_charge_pc == CEILINGS["NET_CHARGE_NC"] * 1_000
    assert maxima.probe_current_ua == CEILINGS["PROBE_CURRENT_UA"]
    assert maxima.probe_width_us == CEILINGS["PROBE_WIDTH_US"]


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        *(
            (BoardMaxima, name, CEILINGS[name.upper()] + 1)
            for name in BoardMaxima.__struct_fields__
        ),
        *(
            (SiteMaxima, name, CEILINGS[name.upper()] + 1)
            for name in SiteMaxima.__struct_fields__
            if name not in ("interval_us", "uncalibrated_current_ua")
        ),
        (SiteMaxima, "uncalibrated_current_ua", CEILINGS["CURRENT_UA"] + 1),
        (SiteMaxima, "interval_us", CEILINGS["INTERVAL_US"] - 1),
    ],
)
def test_a_loader_refuses_a_file_above_a_ceiling(
    kind: type[BoardMaxima | SiteMaxima], key: str, value: int
) -> None:
    given = board_file().maxima if kind is BoardMaxima else body_site().maxima
    plain = msgspec.structs.asdict(given)
    assert msgspec.convert(plain, kind) == given
    with pytest.raises(msgspec.ValidationError, match=key):
        msgspec.convert(plain | {key: value}, kind)


def test_the_shipped_fingertip_has_the_design_figures() -> None:
    maxima = maxima_of(board_file(), body_site())
    assert maxima.uncalibrated_current_ua == 3_000
    assert maxima.charge_pc == 500_000
    assert maxima.rate_hz == 120
    assert maxima.mean_current_ua == 30


@pytest.mark.parametrize(
    ("key", "maximum", "unit"),
    [
        ("current_ua", "current_ua", 1),
        ("width_us", "width_us", 1),
        ("charge_nc", "charge_pc", 1_000),
        ("rate_hz", "rate_hz", 1),
        ("mean_current_ua", "mean_current_ua", 1),
        ("array_mean_current_ua", "array_mean_current_ua", 1),
    ],
)
def test_a_maximum_is_the_smallest_of_code_board_and_site(
    key: str, maximum: str, unit: int
) -> None:
    low = {"current_ua": 400, "width_us": 60}.get(key, 7)
    by_board = maxima_of(board_with(**{key: low}), body_site())
    by_site = maxima_of(board_file(), site_with(**{key: low}))
    assert getattr(by_board, maximum) == low * unit
    assert getattr(by_site, maximum) == low * unit


def test_files_that_got_past_their_loaders_still_meet_the_ceilings_of_the_code() -> None:
    most = {
        "current_ua": 99_000,
        "width_us": 900,
        "charge_nc": 9_000,
        "rate_hz": 999,
        "mean_current_ua": 999,
        "array_mean_current_ua": 99_000,
    }
    site = site_with(**most, on_us_per_s=10**6, array_on_us_per_s=10**7, interval_us=1)
    maxima = maxima_of(board_with(**most), site)
    assert maxima.current_ua == 10_000
    assert maxima.width_us == 200
    assert maxima.charge_pc == 2_000_000
    assert maxima.rate_hz == 200
    assert maxima.mean_current_ua == 120
    assert maxima.array_mean_current_ua == 8_000
    assert maxima.interval_us == 500
    assert maxima.on_us_per_s == 2 * 200 * 200
    assert maxima.array_on_us_per_s == 800_000


def test_neither_the_probe_nor_the_uncalibrated_bound_is_above_the_current() -> None:
    maxima = maxima_of(board_with(current_ua=60, probe_current_ua=300), body_site())
    assert maxima.probe_current_ua == 60
    assert maxima.uncalibrated_current_ua == 60
    assert maxima_of(board_with(width_us=30), body_site()).probe_width_us == 30


def test_what_a_machine_can_time_changes_widths_and_nothing_else() -> None:
    """The ledger and the opening take their numbers once."""
    declared = maxima_of(board_file(), body_site())
    held = MaximaInForce(declared)
    assert not held.follow(16, 200)
    assert (held.now, held.limitations) == (declared, ())
    assert held.follow(22, 45)
    assert (held.now.min_width_us, held.now.width_us, held.now.probe_width_us) == (22, 45, 45)
    widths = {"min_width_us", "width_us", "probe_width_us"}
    for name in Maxima.__slots__:
        assert name in widths or getattr(held.now, name) == getattr(declared, name)
    assert len(held.limitations) == 2
    assert not held.follow(22, 45)
    assert held.follow(16, 120)
    assert (held.now.width_us, held.now.probe_width_us) == (120, 50)
    assert len(held.limitations) == 1


def test_clients_are_told_the_maxima_in_the_units_of_the_protocol() -> None:
    facts = maxima_facts(maxima_of(board_file(), body_site()))
    assert facts.charge_nc == 500
    assert facts.current_ua == 8_000
    assert facts.array_mean_current_ua == 2_000
