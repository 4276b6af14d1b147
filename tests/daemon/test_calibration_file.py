"""Calibration files: read, written, refused; and the map from level to current."""

from __future__ import annotations

import datetime
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.files.array import load_array
from etd.files.body_site import load_body_site
from etd.files.calibration import load_calibration, to_toml
from etd.files.resources import find, names
from etd.protocol.calibration import (
    Calibration,
    ElectrodeLimits,
    check_shape_of_levels,
    current_of_level,
)
from etd.protocol.errors import FileError, Refused
from etd.protocol.frame import Ring
from etd.stabilize.bursts import Bursts
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.shape import PLAIN, Shape
from etd.stabilize.strength_duration import StrengthDuration
from etd_hal.tomlfile import convert
from fake_calibrations import text_of
from files_by_hand import CALIBRATION, spoiled, write

pytestmark = pytest.mark.slow

#: With the electrodes to be filled in.
K = (
    "exponent = {{ k = 0.7, low = 0.6, high = 0.8, explained = 0.9, electrodes = [{}], states = 5,"
    ' fold = 3.0, date = 2025-01-15, board = "kajimoto-hv507", leak_ohm = 66000 }}\n'
)


@st.composite
def limits(draw: st.DrawFn) -> ElectrodeLimits:
    threshold_ua, comfortable_ua, cap_ua = sorted(
        draw(st.tuples(*[st.integers(0, 10_000) for _ in range(3)]))
    )
    return ElectrodeLimits(
        threshold_ua=threshold_ua,
        comfortable_ua=comfortable_ua,
        cap_ua=cap_ua,
        resistance_ohm=draw(st.none() | st.integers(1_000, 2_000_000)),
        felt=draw(st.booleans()),
        date=draw(st.none() | st.dates()),
        threshold_date=draw(st.none() | st.dates()),
    )


TEXT = st.text(st.characters(exclude_categories=["Cc", "Cf", "Cs", "Zl", "Zp"]), max_size=20)
#: The last one is for the four electrodes of `CALIBRATIONS`.
RETURNS = st.one_of(
    st.just("all"),
    st.builds(Ring, st.floats(0.1, 100)),
    st.just(((1, 2), (), (3,), (0, 1, 2))),
)
SHAPES = st.builds(
    Shape,
    strength_duration=st.none()
    | st.builds(StrengthDuration, width_us=st.integers(20, 200), tau_us=st.floats(50.0, 2_000.0)),
    prepulse=st.none()
    | st.builds(Prepulse, below_db=st.floats(2.0, 10.0), width_us=st.integers(20, 150)),
    bursts=st.none()
    | st.builds(Bursts, pulses=st.integers(2, 20), rate_hz=st.floats(50.0, 1_500.0)),
    probe_first=st.booleans(),
)
CALIBRATIONS = st.builds(
    Calibration,
    participant=st.from_regex(r"\A[A-Za-z0-9_-]{1,32}\Z"),
    body_site=TEXT,
    array=TEXT,
    polarity=st.sampled_from(["anodic", "cathodic", "biphasic", "biphasic_cathodic_first"]),
    width_us=st.integers(20, 200),
    rate_hz=st.floats(0.1, 200),
    returns=RETURNS,
    date=st.dates(),
    program=TEXT,
    electrode=st.lists(limits(), min_size=4, max_size=4).map(tuple),
    method=st.none() | st.sampled_from(["limits", "staircase", "quest-plus", "equalize"]),
    pulses=st.none() | st.integers(1, 1_000),
    gamma=st.floats(0.5, 3.0),
    shape=SHAPES,
    seed=st.none() | st.integers(0, 2**31 - 1),
    catch_trials=st.none() | st.integers(1, 1_000),
    false_alarm_rate=st.none() | st.floats(0.0, 1.0),
    is_whole_accepted=st.sampled_from([None, True]),
    drift=st.none() | st.floats(-1.0, 9.0),
    skin_celsius=st.none() | st.floats(5.0, 45.0),
)


@given(calibration=CALIBRATIONS)
def test_what_is_written_is_read_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, calibration: Calibration
) -> None:
    path = write(tmp_path_factory.mktemp("c"), "c.toml", to_toml(calibration))
    assert load_calibration(path) == calibration


def test_a_written_calibration_is_one_that_a_person_can_read() -> None:
    text = to_toml(
        Calibration(
            participant="P01",
            body_site="fingertip",
            array="grid-4x4",
            polarity="anodic",
            width_us=100,
            rate_hz=60.0,
            returns=Ring(5.0),
            shape=Shape(prepulse=Prepulse(below_db=6.0, width_us=50)),
            date=datetime.date(2025, 1, 15),
            program="etd 0.1.0",
            electrode=(ElectrodeLimits(threshold_ua=900, comfortable_ua=1800, cap_ua=2500),),
        )
    )
    assert 'participant = "P01"\n' in text
    assert "returns = { ring_mm = 5.0 }\n" in text
    assert "shape = { prepulse = { below_db = 6.0, width_us = 50 } }\n" in text
    assert "    { threshold_ua = 900, comfortable_ua = 1800, cap_ua = 2500 },\n" in text


def test_a_file_that_says_nothing_of_it_is_of_plain_pulses(tmp_path: Path) -> None:
    assert "shape" not in CALIBRATION
    assert load_calibration(write(tmp_path, "c.toml", CALIBRATION)).shape == PLAIN


BURSTS = Bursts(pulses=6, rate_hz=350.0)


@pytest.mark.parametrize(
    ("made_with", "now", "said"),
    [
        (PLAIN, Shape(bursts=BURSTS), "which is plain pulses.*now makes bursts of 6 at 350 Hz"),
        (Shape(bursts=BURSTS), PLAIN, "which is bursts of 6 at 350 Hz.*now makes plain pulses"),
        (
            PLAIN,
            Shape(prepulse=Prepulse(below_db=6.0, width_us=50)),
            "a prepulse of 50 us, 6 dB below of it: restore that, calibrate anew, or open",
        ),
        (
            PLAIN,
            Shape(strength_duration=StrengthDuration(width_us=50, tau_us=151.0)),
            r"narrowed to 50 us \(tau 151",
        ),
        (PLAIN, Shape(probe_first=True), "now makes a probe before each of it"),
        (
            Shape(bursts=BURSTS),
            Shape(bursts=Bursts(pulses=6, rate_hz=300.0)),
            "at 350 Hz; .* at 300 Hz",
        ),
    ],
)
def test_levels_of_another_shape_of_pulse_are_refused(
    tmp_path: Path, made_with: Shape, now: Shape, said: str
) -> None:
    calibration = load_calibration(write(tmp_path, "c.toml", CALIBRATION))
    calibration = msgspec.structs.replace(calibration, shape=made_with)
    with pytest.raises(Refused, match=said):
        check_shape_of_levels(calibration, now)
    check_shape_of_levels(calibration, made_with)


def test_pulses_that_are_narrow_already_are_not_made_another_shape(tmp_path: Path) -> None:
    calibration = load_calibration(write(tmp_path, "c.toml", CALIBRATION))
    check_shape_of_levels(
        calibration,
        Shape(strength_duration=StrengthDuration(width_us=calibration.width_us, tau_us=151.0)),
    )
    with pytest.raises(Refused):
        check_shape_of_levels(
            calibration,
            Shape(
                strength_duration=StrengthDuration(width_us=calibration.width_us - 1, tau_us=151.0)
            ),
        )


@given(
    electrode_limits=limits(), low=st.floats(0, 1), high=st.floats(0, 1), gamma=st.floats(0.5, 3.0)
)
def test_a_higher_level_never_means_less_and_no_level_means_more_than_comfortable(
    electrode_limits: ElectrodeLimits, low: float, high: float, gamma: float
) -> None:
    low, high = sorted((low, high))
    low_ua, high_ua = (current_of_level(electrode_limits, level, gamma) for level in (low, high))
    assert low_ua <= high_ua <= electrode_limits.comfortable_ua <= electrode_limits.cap_ua
    assert current_of_level(electrode_limits, 0.0, gamma) == 0
    assert current_of_level(electrode_limits, 1.0, gamma) == electrode_limits.comfortable_ua


def test_the_least_level_is_at_the_threshold_and_half_of_it_half_way() -> None:
    limits = ElectrodeLimits(threshold_ua=1000, comfortable_ua=2000, cap_ua=3000)
    assert current_of_level(limits, 1e-9, 1.0) == 1000
    assert current_of_level(limits, 0.5, 1.0) == 1500


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("comfortable_ua = 2000", "comfortable_ua = 3001", r"electrode\[0\]: .* do not rise"),
        ("threshold_ua = 900", "threshold_ua = 1801", r"electrode\[1\]: .* do not rise"),
        ("cap_ua = 3000", "cap_ua = 10001", r"electrode\[0\]\.cap_ua: it says 10001"),
        (", cap_ua = 3000 },\n]", " },\n]", r"electrode\[2\].*missing required field `cap_ua`"),
        ("50000", "0", r"electrode\[0\]\.resistance_ohm: it says 0, .* too low .* leave it out"),
        ("50000", "999", r"electrode\[0\]\.resistance_ohm: it says 999, .* from 1000 to 2000000"),
        ("50000", "-50000", r"electrode\[0\]\.resistance_ohm: it says -50000, .* too low"),
        ("50000", "2000001", r"electrode\[0\]\.resistance_ohm: it says 2000001, .* too high"),
        ('"P01"', '"Anna Smith"', "participant: it says 'Anna Smith'"),
        ('returns = "all"', 'returns = "some"', "returns: it says 'some'"),
        ("rate_hz = 60.0", "rate_hz = nan", "rate_hz: it says nan"),
        ("width_us = 100", "width_us = 100.5", "width_us: it says 100.5"),
        ("date = 2025-01-15", 'date = "soon"', "date: it says 'soon'"),
        ('"all"', "[[1], [2]]", "returns: 2 lists for 3 electrodes"),
        ('"all"', "[[1], [2], [3]]", r"returns\[2\]: it names \[3\]"),
        ('"all"', "[[1], [1], [0]]", r"returns\[1\]: it names \[1\]"),
        ('"all"', "[[1], [0], [1, 1]]", r"returns\[2\]: it names \[1, 1\]"),
        ('"all"', "[[-1], [0], [1]]", r"returns\[0\]: it names \[-1\]"),
        ("width_us", "width", "unknown field `width`"),
        ("program =", K.format("0, 1, 2, 3") + "program =", r"exponent\.electrodes: .* 0 to 2, "),
        ("program =", K.format("0, 1, 1") + "program =", r"exponent\.electrodes: .* each once"),
        ("program =", K.format("0, 99") + "program =", r"exponent\.electrodes: .*\[0, 99\]"),
    ],
)
def test_a_spoiled_calibration_is_refused_by_electrode_or_key(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence):
        load_calibration(write(tmp_path, "c.toml", spoiled(CALIBRATION, old, new)))


@pytest.mark.parametrize("resistance_ohm", [1_000, 2_000_000])
def test_the_least_and_the_most_that_skin_resists_are_taken(
    tmp_path: Path, resistance_ohm: int
) -> None:
    text = spoiled(CALIBRATION, "50000", str(resistance_ohm))
    assert load_calibration(write(tmp_path, "c.toml", text)).electrode[0].resistance_ohm == (
        resistance_ohm
    )


@pytest.mark.parametrize("name", names("calibrations"))
def test_a_shipped_calibration_fits_its_array_and_stays_below_its_body_site(name: str) -> None:
    calibration = load_calibration(find("calibrations", name))
    maxima = load_body_site(find("bodysites", calibration.body_site)).maxima
    array = load_array(find("arrays", calibration.array))
    assert len(calibration.electrode) == array.count
    cap_ua = max(limits.cap_ua for limits in calibration.electrode)
    assert cap_ua <= maxima.current_ua
    assert cap_ua * calibration.width_us / 1_000 <= maxima.charge_nc
    assert cap_ua * calibration.width_us * calibration.rate_hz / 1e6 <= maxima.mean_current_ua
    assert calibration.rate_hz <= maxima.rate_hz


@pytest.mark.parametrize("name", names("calibrations"))
def test_a_shipped_calibration_is_that_of_the_fakes_own_body(name: str) -> None:
    file = find("calibrations", name)
    assert file.read_text() == text_of(file), "run: python tests/fake_calibrations.py"


@pytest.mark.parametrize("name", names("calibrations"))
def test_a_shipped_calibration_is_that_of_a_dry_fingertip(name: str) -> None:
    found = load_calibration(find("calibrations", name))
    # Cathodic pulses need 1.3 times as much (Kaczmarek et al. 2000).
    most_ua = 2_500 if found.polarity == "anodic" else 3_250
    for limits in found.electrode:
        assert 600 <= limits.threshold_ua <= most_ua
        assert 1.0 < limits.comfortable_ua / limits.threshold_ua <= 2.05
        assert limits.resistance_ohm is not None
        assert 20_000 <= limits.resistance_ohm <= 150_000


def test_every_value_of_a_calibration_is_required_but_resistance_and_gamma() -> None:
    with pytest.raises(FileError, match="missing required field"):
        convert({"participant": "P01"}, Calibration, "c.toml")
