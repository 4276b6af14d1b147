"""Maps of calibrations and strips of patterns: each number and shade is the file's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from drawn_svg import Drawing, is_rising
from etd.draw.calibration_map import calibration_map
from etd.draw.palette import ink_on, lightness, shade
from etd.draw.pattern_strip import MOST_FRAMES, pattern_strip
from etd.files.array import Array, load_array
from etd.files.calibration import load_calibration
from etd.files.pattern import Pattern, PatternFrame, load_pattern
from etd.files.resources import find
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.frame import Ring
from files_by_hand import CONFIG, ETACTILEKIT_DATA

pytestmark = pytest.mark.slow

CALIBRATIONS = sorted((CONFIG / "calibrations").glob("*.toml"))
PAD = load_array(find("arrays", "pad-8"))
PAD_8 = load_calibration(CONFIG / "calibrations" / "fake-fingertip-pad-8.toml")


def mapped(calibration: Calibration, array: Array = PAD) -> Drawing:
    return Drawing(calibration_map(calibration, array).svg)


def limits(
    threshold_ua: int, comfortable_ua: int, cap_ua: int, felt: bool = True
) -> ElectrodeLimits:
    return ElectrodeLimits(
        threshold_ua=threshold_ua, comfortable_ua=comfortable_ua, cap_ua=cap_ua, felt=felt
    )


currents = st.lists(st.integers(0, 10_000), min_size=3, max_size=3).map(sorted)


# --- calibrations ------------------------------------------------------------------------------


@pytest.mark.parametrize("path", CALIBRATIONS, ids=lambda path: path.stem)
def test_a_shipped_calibration_is_drawn_as_it_is(path: Path) -> None:
    calibration = load_calibration(path)
    drawing = mapped(calibration, load_array(find("arrays", calibration.array)))
    drawing.check_on_paper()
    assert drawing.overlapping() == []
    check_values(drawing, calibration)


def check_values(drawing: Drawing, calibration: Calibration) -> None:
    shades: dict[str, list[tuple[int, float]]] = {"threshold": [], "comfortable": [], "room": []}
    for index, found in enumerate(calibration.electrode):
        values = {
            "threshold": found.threshold_ua,
            "comfortable": found.comfortable_ua,
            "room": found.cap_ua - found.comfortable_ua,
        }
        for mark, value in values.items():
            assert drawing.text(f"{mark}-number-{index}") == str(index)
            written = drawing.text(f"{mark}-value-{index}")
            circle = drawing.marks[f"{mark}-electrode-{index}"]
            if found.felt:
                assert written == str(value)
                assert circle.get("stroke-dasharray") is None
                shades[mark].append((value, -lightness(drawing.fill(f"{mark}-electrode-{index}"))))
            else:
                assert written == "–"
                assert circle.get("stroke-dasharray") is not None
                assert drawing.fill(f"{mark}-electrode-{index}") == "#FFFFFF"
    for pairs in shades.values():
        assert is_rising([dark for _, dark in sorted(pairs)])


@given(st.lists(st.tuples(currents, st.booleans()), min_size=8, max_size=8))
@settings(max_examples=40, deadline=None)
def test_any_calibration_is_drawn_as_it_is(drawn: list[tuple[list[int], bool]]) -> None:
    electrodes = tuple(limits(low, mid, cap, felt) for (low, mid, cap), felt in drawn)
    calibration = replace(PAD_8, electrode=electrodes)
    drawing = mapped(calibration)
    drawing.check_on_paper()
    assert drawing.overlapping() == []
    check_values(drawing, calibration)


def test_electrodes_lie_as_in_the_array_seen_from_the_skin() -> None:
    drawing = mapped(PAD_8)
    first = drawing.circle("threshold-electrode-0")
    pitch = PAD.pitch_mm()
    cell = drawing.circle("threshold-electrode-1")[0] - first[0]
    for index, electrode in enumerate(PAD.electrode):
        x, y, _ = drawing.circle(f"room-electrode-{index}")
        origin = drawing.circle("room-electrode-0")
        scale = cell / pitch
        assert x - origin[0] == pytest.approx((electrode.x_mm - PAD.x_mm[0]) * scale, abs=0.01)
        assert y - origin[1] == pytest.approx((PAD.y_mm[0] - electrode.y_mm) * scale, abs=0.01)


def test_the_conditions_are_beside_the_maps() -> None:
    calibration = replace(PAD_8, returns=Ring(5.0), method="staircase", participant="P07")
    words = mapped(calibration).words()
    assert "Calibration of P07" in words
    assert "pad-8 on the fingertip, 2025-01-15, etd 0.1.0, method staircase" in words
    assert "anodic, 100 us, 60 Hz, returns: a ring of 5 mm; plain pulses; gamma 1;" in words
    assert "caps up to 4000 uA" in words
    assert "crossed out: not felt up to its cap, or not tried" in words


def test_the_ends_of_each_scale_are_written_beside_the_values() -> None:
    words = mapped(PAD_8).words().splitlines()
    on_electrodes = [
        str(value)
        for found in PAD_8.electrode
        for value in (
            found.threshold_ua,
            found.comfortable_ua,
            found.cap_ua - found.comfortable_ua,
        )
    ]
    for end in ("990", "1660", "1970", "3140", "510", "2030"):
        assert words.count(end) == on_electrodes.count(end) + 1


def test_maps_keep_to_the_margin_and_below_their_titles() -> None:
    drawing = mapped(PAD_8)
    for mark in ("threshold", "comfortable", "room"):
        circles = [drawing.circle(f"{mark}-electrode-{index}") for index in range(8)]
        assert min(x - radius for x, _, radius in circles) >= 3.0 - 0.01
        titles = [box for box in drawing.boxes() if box.what == "to the fingertip"]
        below = min(y - radius for _, y, radius in circles)
        assert any(0.0 < below - box.bottom < 4.0 for box in titles)


def test_a_calibration_in_which_nothing_was_felt_has_no_scale() -> None:
    electrodes = tuple(limits(3000, 3000, 3000, felt=False) for _ in range(8))
    picture = calibration_map(replace(PAD_8, electrode=electrodes), PAD)
    assert picture.summary.endswith("of 0 electrodes on pad-8; 8 without values are crossed out")
    assert Drawing(picture.svg).words().count("no electrode was felt") == 3


# --- shades ------------------------------------------------------------------------------------


def test_the_scale_falls_in_lightness_so_that_it_survives_a_printer_without_color() -> None:
    dark = [-lightness(shade(step / 100)) for step in range(101)]
    assert is_rising(dark)
    assert dark[-1] - dark[0] > 0.7
    assert all(dark[at + 10] - dark[at] > 0.04 for at in range(91))


def test_letters_stand_out_from_every_shade() -> None:
    for step in range(101):
        color = shade(step / 100)
        assert abs(lightness(color) - lightness(ink_on(color))) > 0.35


# --- patterns ----------------------------------------------------------------------------------


def frame(*level: float, duration_ms: int = 30, off_ms: int = 0) -> PatternFrame:
    padded = tuple(level) + (0.0,) * (8 - len(level))
    return PatternFrame(
        duration_ms=duration_ms, off_ms=off_ms, level=padded, rate_hz=None, polarity=None
    )


def strip(pattern: Pattern, array: Array = PAD) -> Drawing:
    return Drawing(pattern_strip(pattern, array, "wave").svg)


def frames_shown(drawing: Drawing) -> list[int]:
    found = (re.fullmatch(r"frame-(\d+)", str(mark)) for mark in drawing.marks)
    return [int(match[1]) for match in found if match]


@given(st.integers(1, 700))
@settings(max_examples=25, deadline=None)
def test_frames_are_all_shown_or_evenly_sampled_and_this_is_told(count: int) -> None:
    picture = pattern_strip(Pattern(electrodes=8, frames=(frame(1.0),) * count), PAD, "wave")
    drawing = Drawing(picture.svg)
    shown = frames_shown(drawing)
    assert shown[0] == 0
    assert len(shown) <= MOST_FRAMES
    step = shown[1] if len(shown) > 1 else 1
    assert shown == list(range(0, count, step))
    assert (step == 1) == (count <= MOST_FRAMES)
    told = re.search(r"every (\d+)(?:st|nd|rd|th) of (\d+) frames", drawing.words())
    assert (told is None) == (step == 1)
    if told is not None:
        assert (int(told[1]), int(told[2])) == (step, count)
        assert told[0] in picture.summary


@pytest.mark.parametrize(
    ("count", "told"),
    [(61, "every 2nd of 61"), (121, "every 3rd of 121"), (600, "every 10th of 600"),
     (660, "every 11th of 660"), (1201, "every 21st of 1201")],
)  # fmt: skip
def test_the_step_is_told_in_words(count: int, told: str) -> None:
    pattern = Pattern(electrodes=8, frames=(frame(1.0),) * count)
    assert told in pattern_strip(pattern, PAD, "wave").summary


@given(st.lists(st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8), min_size=1, max_size=5))
@settings(max_examples=40, deadline=None)
def test_every_level_has_its_shade_and_silence_is_white(levels: list[list[float]]) -> None:
    drawing = strip(Pattern(electrodes=8, frames=tuple(frame(*level) for level in levels)))
    drawing.check_on_paper()
    assert drawing.overlapping() == []
    pairs: list[tuple[float, float]] = []
    for number, level in enumerate(levels):
        circles = list(drawing.marks[f"frame-{number}"])
        assert len(circles) == 8
        for value, circle in zip(level, circles, strict=True):
            assert (circle.get("fill") == "#FFFFFF") == (value == 0.0)
            pairs.append((value, -lightness(str(circle.get("fill")))))
    assert is_rising([dark for _, dark in sorted(pairs)])


def test_a_frame_says_when_it_begins_and_what_the_file_says_of_it() -> None:
    frames = (
        frame(1.0, duration_ms=30, off_ms=5),
        replace(frame(duration_ms=1_000), rate_hz=62.5, polarity="cathodic"),
        frame(0.5, duration_ms=600_000),
    )
    drawing = strip(Pattern(electrodes=8, frames=frames))
    assert [drawing.text(f"frame-{number}-time") for number in range(3)] == [
        "0: at 0 s",
        "1: at 0.035 s",
        "2: at 1.035 s",
    ]
    words = drawing.words()
    assert "30 ms, then 5 ms off" in words
    assert "62.5 Hz, cathodic" in words
    assert "3 frames for 8 electrodes, 601.035 s, up to 1 active" in words


def test_the_latest_frame_there_can_be_has_an_exact_time() -> None:
    long = frame(1.0, duration_ms=600_000, off_ms=599_999)
    drawing = strip(Pattern(electrodes=8, frames=(long,) * 20_000))
    last = frames_shown(drawing)[-1]
    assert drawing.text(f"frame-{last}-time") == f"{last}: at {last * 1_199_999 / 1000:.3f} s"
    assert drawing.overlapping() == []


def test_the_key_names_every_electrode_at_its_place() -> None:
    drawing = strip(Pattern(electrodes=8, frames=(frame(1.0),)))
    for index in range(8):
        assert drawing.text(f"key-number-{index}") == str(index)
    assert drawing.circle("key-electrode-0")[1] < drawing.circle("key-electrode-7")[1]


def test_a_pattern_for_256_electrodes_is_legible() -> None:
    array = load_array(find("arrays", "grid-16x16"))
    level = tuple(index / 255 for index in range(256))
    frames = tuple(replace(frame(), level=level) for _ in range(3))
    drawing = strip(Pattern(electrodes=256, frames=frames), array)
    drawing.check_on_paper()
    assert drawing.overlapping() == []
    assert float(drawing.marks["key-number-255"].attrib["font-size"]) >= 1.5
    assert drawing.width == 190.0


@pytest.mark.parametrize(
    ("name", "array"),
    [("pattern_spiral_arms_8", "pad-8"), ("pattern_sine_wave_64", "grid-8x8")],
)
def test_a_pattern_of_another_kit_is_drawn(name: str, array: str) -> None:
    path = ETACTILEKIT_DATA / f"{name}.json"
    if not path.exists():
        pytest.skip("eTactileKit's own files are not beside this checkout")
    pattern, _ = load_pattern(path)
    drawing = strip(pattern, load_array(find("arrays", array)))
    drawing.check_on_paper()
    for number in frames_shown(drawing):
        fills = [circle.get("fill") != "#FFFFFF" for circle in drawing.marks[f"frame-{number}"]]
        assert fills == [level > 0 for level in pattern.frames[number].level]
