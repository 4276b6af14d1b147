"""Body sites: what nobody gets more of, and the yardstick beside it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import msgspec
import pytest

from etd.files.body_site import BodySite, load_body_site, passes_yardstick, yardstick_nc
from etd.protocol.errors import FileError
from etd_hal.tomlfile import convert
from files_by_hand import CONFIG, spoiled, write

FINGERTIP = (CONFIG / "bodysites" / "fingertip.toml").read_text(encoding="utf-8")


def load(folder: Path, text: str) -> BodySite:
    return load_body_site(write(folder, "site.toml", text))


@pytest.mark.parametrize("name", sorted(each.stem for each in (CONFIG / "bodysites").iterdir()))
def test_no_shipped_site_lets_the_persons_word_raise(name: str) -> None:
    assert not load_body_site(CONFIG / "bodysites" / f"{name}.toml").felt_may_raise


def test_a_site_that_does_not_say_raises_nothing(tmp_path: Path) -> None:
    lines = FINGERTIP.splitlines(keepends=True)
    left = [line for line in lines if not line.startswith("felt_may_raise")]
    assert len(left) == len(lines) - 1
    assert not load(tmp_path, "".join(left)).felt_may_raise


@pytest.mark.parametrize("name", ["fingertip", "forearm"])
def test_the_shipped_sites_load_and_stay_within_the_yardstick(name: str) -> None:
    site = load_body_site(CONFIG / "bodysites" / f"{name}.toml")
    assert site.name == name
    assert passes_yardstick(site)


def test_the_fingertip_has_the_figures_that_are_promised() -> None:
    maxima = load_body_site(CONFIG / "bodysites" / "fingertip.toml").maxima
    assert maxima.uncalibrated_current_ua == 3_000
    assert maxima.charge_nc == 500
    assert maxima.rate_hz == 120
    assert maxima.mean_current_ua == 30


def test_the_forearm_allows_no_more_than_the_fingertip() -> None:
    fingertip = load_body_site(CONFIG / "bodysites" / "fingertip.toml").maxima
    forearm = load_body_site(CONFIG / "bodysites" / "forearm.toml").maxima
    more = [
        key
        for key, value in msgspec.structs.asdict(forearm).items()
        if value > getattr(fingertip, key)
    ]
    assert more == ["interval_us"]


def test_the_yardstick_is_half_a_microcoulomb_at_a_millimeter_and_grows_with_the_diameter() -> None:
    assert yardstick_nc(1.0) == pytest.approx(498.4, abs=0.1)
    assert yardstick_nc(2.0) == pytest.approx(2 * yardstick_nc(1.0))


def test_a_site_with_more_charge_than_the_yardstick_does_not_pass_it(tmp_path: Path) -> None:
    assert not passes_yardstick(
        load(tmp_path, spoiled(FINGERTIP, "charge_nc = 500", "charge_nc = 600"))
    )


MAXIMA = (
    "uncalibrated_current_ua",
    "current_ua",
    "width_us",
    "charge_nc",
    "rate_hz",
    "interval_us",
    "mean_current_ua",
    "array_mean_current_ua",
    "on_us_per_s",
    "array_on_us_per_s",
)


@pytest.mark.parametrize("key", MAXIMA)
def test_a_missing_limit_is_a_refusal_that_names_it(key: str) -> None:
    content = tomllib.loads(FINGERTIP)
    del content["maxima"][key]
    with pytest.raises(FileError, match=f"missing required field `{key}`") as caught:
        convert(content, BodySite, "site.toml")
    assert caught.value.key == "maxima"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("current_ua = 8_000", "current_ua = 10_001", "maxima.current_ua: it says 10001"),
        ("width_us = 200", "width_us = 201", "maxima.width_us: it says 201"),
        ("charge_nc = 500", "charge_nc = 2_001", "maxima.charge_nc: it says 2001"),
        ("rate_hz = 120", "rate_hz = 201", "maxima.rate_hz: it says 201"),
        (
            "\nmean_current_ua = 30",
            "\nmean_current_ua = 121",
            "maxima.mean_current_ua: it says 121",
        ),
        (
            "array_mean_current_ua = 2_000",
            "array_mean_current_ua = 8_001",
            "maxima.array_mean_current_ua: it says 8001",
        ),
    ],
)
def test_no_file_passes_a_hard_ceiling(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    with pytest.raises(FileError, match=sentence):
        load(tmp_path, spoiled(FINGERTIP, old, new))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "uncalibrated_current_ua = 3_000",
            "uncalibrated_current_ua = 9_000",
            "9000 is above maxima.current_ua",
        ),
        (
            "array_mean_current_ua = 2_000",
            "array_mean_current_ua = 29",
            "30 is above maxima.array_mean",
        ),
        (
            "array_on_us_per_s = 500_000",
            "array_on_us_per_s = 23_999",
            "24000 is above maxima.array_on_us",
        ),
        ("touch_fraction = 0.80", "touch_fraction = 0.92", "0.92 is not below open_fraction"),
        ("touch_fraction = 0.80", "touch_fraction = nan", "contact.touch_fraction: it says nan"),
        (
            "electrode_diameter_mm = 1.0",
            "electrode_diameter_mm = nan",
            "electrode_diameter_mm: it says nan",
        ),
        ("rate_hz = 60.0", "rate_hz = 121.0", "defaults.rate_hz: 121.0 is above maxima.rate_hz"),
        ('"anodic"', '"upwards"', "defaults.polarity: it says 'upwards'"),
        ("charge_nc = 500", "charge_nC = 500", "maxima: "),
    ],
)
def test_a_site_that_contradicts_itself_is_refused_by_key(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence):
        load(tmp_path, spoiled(FINGERTIP, old, new))


BURSTS = "\n[stabilize.bursts]\npulses = 2\nrate_hz = 350.0\n"


def test_bursts_within_the_maxima_hold_together(tmp_path: Path) -> None:
    bursts = load(tmp_path, FINGERTIP + BURSTS).stabilize.bursts
    assert bursts is not None
    assert bursts.interval_us == pytest.approx(2_857.1, abs=0.1)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("rate_hz = 350.0", "rate_hz = 501.0", "a pulse every 1996 us, maxima.interval_us is 2000"),
        ("pulses = 2", "pulses = 3", "60 bursts of 3 pulses are more than maxima.rate_hz"),
        ("pulses = 2", "pulses = 1", "bursts.pulses"),
    ],
)
def test_bursts_that_the_maxima_forbid_are_refused(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence):
        load(tmp_path, FINGERTIP + spoiled(BURSTS, old, new))


def test_a_default_width_above_the_maximum_is_refused(tmp_path: Path) -> None:
    text = spoiled(FINGERTIP, "width_us = 200", "width_us = 90")
    with pytest.raises(FileError, match=r"defaults\.width_us: 100 is above maxima\.width_us"):
        load(tmp_path, text)


def test_a_k_of_earlier_days_is_told_where_it_stands_now(tmp_path: Path) -> None:
    old = FINGERTIP + '\n[stabilize]\norder = ["power_law"]\n[stabilize.power_law]\nk = 1.05\n'
    with pytest.raises(FileError, match=r"stabilize\.power_law\.k: .*\(etd calibrate CODE --fit\)"):
        load(tmp_path, old)
    with pytest.raises(FileError, match=r"stabilize\.power_law: .*unknown field `kk`; remove it"):
        load(tmp_path, spoiled(old, "k = 1.05", "kk = 1.05"))
