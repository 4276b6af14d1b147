"""Pattern files, ours and eTactileKit's, and its layouts: what is taken, mended, refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.files.array import Array
from etd.files.etactilekit import read_layout
from etd.files.json_file import MAX_BYTES
from etd.files.pattern import Pattern, PatternFrame, load_pattern
from etd.protocol.errors import FileError, PatternError
from files_by_hand import (
    ETACTILEKIT_DATA,
    LAYOUT,
    PATTERN,
    kit_frame,
    kit_pattern,
    pattern_to_json,
    spoiled,
    write,
)

real_files = pytest.mark.skipif(
    not ETACTILEKIT_DATA.is_dir(), reason="the real files of that kit do not lie beside this clone"
)


def load(folder: Path, text: str) -> tuple[Pattern, tuple[str, ...]]:
    return load_pattern(write(folder, "pattern.json", text))


def load_layout(folder: Path, **changes: object) -> tuple[Array, tuple[str, ...]]:
    layout = {key: value for key, value in (LAYOUT | changes).items() if value is not None}
    return read_layout(write(folder, "layout.json", json.dumps(layout)))


def test_a_pattern_of_ours_says_how_strongly_each_electrode_is_felt(tmp_path: Path) -> None:
    pattern, mended = load(tmp_path, PATTERN)
    assert mended == ()
    assert pattern.electrodes == 3
    assert pattern.duration_ms == 75
    first, second = pattern.frames
    assert (first.level, first.active, first.rate_hz) == ((1.0, 0.0, 1.0), (0, 2), None)
    assert (second.level, second.off_ms, second.rate_hz) == ((0.0, 0.5, 1.0), 5, 50.0)
    assert (first.polarity, second.polarity) == (None, "cathodic")


@st.composite
def patterns(draw: st.DrawFn) -> Pattern:
    electrodes = draw(st.integers(1, 12))
    frame = st.builds(
        PatternFrame,
        duration_ms=st.integers(1, 600_000),
        off_ms=st.integers(0, 600_000),
        level=st.tuples(*[st.sampled_from([0.0, 1.0]) | st.floats(0, 1)] * electrodes),
        rate_hz=st.none() | st.floats(0.1, 200),
        polarity=st.none() | st.sampled_from(["anodic", "biphasic_cathodic_first"]),
    )
    frames = draw(st.lists(frame, min_size=1, max_size=5))
    return Pattern(electrodes=electrodes, frames=tuple(frames))


@given(pattern=patterns())
def test_a_written_pattern_is_read_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, pattern: Pattern
) -> None:
    assert load(tmp_path_factory.mktemp("p"), pattern_to_json(pattern)) == (pattern, ())


@pytest.mark.parametrize(
    ("old", "new", "frame", "sentence"),
    [
        ("[0, 2]", "[0, 3]", 0, "active names electrode 3: 0 to 2"),
        ("[0, 2]", "[2, 2]", 0, "active names an electrode twice"),
        ("[0, 2]", "[0, -1]", 0, r"active\[1\]: it says -1"),
        ('"active": [0, 2]', '"off_ms": 1', 0, "give level or active"),
        ("[0.0, 0.5, 1.0]", "[0.0, 0.5]", 1, "level has 2 values for 3 electrodes"),
        ("[0.0, 0.5, 1.0]", "[0.0, 0.5, 1.5]", 1, r"level\[2\]: it says 1\.5"),
        ("[0.0, 0.5, 1.0]", '[0.0, 0.5, "1"]', 1, r"level\[2\]: it says '1'"),
        ('"rate_hz": 50', '"rate_hz": 201', 1, "rate_hz: it says 201"),
        ('"duration_ms": 40', '"duration_ms": 0', 1, "duration_ms: it says 0"),
        ('"duration_ms": 40', '"duration_ms": 600001', 1, "duration_ms: it says 600001"),
        ('"off_ms": 5', '"off_sm": 5', 1, "unknown field `off_sm`"),
        ('"etd_pattern": 1', '"etd_pattern": 2', None, "etd_pattern: it says 2"),
        ('"electrodes": 3', '"electrodes": 257', None, "electrodes: it says 257"),
        ("0.5", "NaN", None, "NaN is not a number"),
        ("0.5", "Infinity", None, "Infinity is not a number"),
        (
            '"etd_pattern": 1',
            '"etd_pattern": 1, "electrodes": 2',
            None,
            "'electrodes' is there twice",
        ),
    ],
)
def test_a_spoiled_pattern_of_ours_is_refused_by_frame_and_reason(
    tmp_path: Path, old: str, new: str, frame: int | None, sentence: str
) -> None:
    with pytest.raises(PatternError, match=sentence) as caught:
        load(tmp_path, spoiled(PATTERN, old, new))
    assert caught.value.frame == frame
    assert caught.value.file == str(tmp_path / "pattern.json")


def test_a_pattern_of_ours_is_not_mended(tmp_path: Path) -> None:
    with pytest.raises(PatternError, match="a comma before a closing bracket"):
        load(tmp_path, spoiled(PATTERN, "[0, 2]", "[0, 2,]"))


def test_a_file_that_is_neither_ours_nor_the_kits_is_refused(tmp_path: Path) -> None:
    for text in ('{"frames": []}', "[]", "3"):
        with pytest.raises(PatternError, match="neither etd_pattern nor Pattern_Data"):
            load(tmp_path, text)


def test_a_file_that_is_not_there_or_too_large_or_endlessly_nested_is_refused(
    tmp_path: Path,
) -> None:
    with pytest.raises(PatternError, match="there is no such file"):
        load_pattern(tmp_path / "none.json")
    with pytest.raises(PatternError, match="it is not a file"):
        load_pattern(tmp_path)
    with pytest.raises(PatternError, match="it is nested too deep"):
        load(tmp_path, "[" * 100_000)
    with pytest.raises(PatternError, match="at most"):
        load(tmp_path, " " * (MAX_BYTES + 1))
    with pytest.raises(PatternError, match="it is not JSON"):
        load(tmp_path, "9" * 5_000)


@given(text=st.text(alphabet='{}[],:"aN10-e. \\\n', max_size=60))
def test_no_text_makes_the_reader_do_anything_but_refuse(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    with pytest.raises(PatternError):
        load(tmp_path_factory.mktemp("p"), text)


def test_a_pattern_of_the_kit_becomes_one_of_ours(tmp_path: Path) -> None:
    text = kit_pattern(
        kit_frame([0, 1, 0]),
        kit_frame([1, 0, 1], delay={"ON": 20, "OFF": 500}),
        kit_frame([0, 0, 0], params={"frequency": 45, "stim_mode": 0}),
    )
    pattern, mended = load(tmp_path, text)
    assert mended == ()
    assert [frame.active for frame in pattern.frames] == [(1,), (0, 2), ()]
    assert [frame.duration_ms for frame in pattern.frames] == [30, 20, 30]
    assert [frame.off_ms for frame in pattern.frames] == [0, 500, 0]
    assert [frame.polarity for frame in pattern.frames] == ["anodic", "anodic", "cathodic"]
    assert [frame.rate_hz for frame in pattern.frames] == [75, 75, 45]


def test_a_bare_word_and_a_trailing_comma_are_mended_and_said(tmp_path: Path) -> None:
    text = spoiled(kit_pattern(kit_frame([0, 1])), "[0, 1]", "[0, 1,\n]")
    text = spoiled(text, '"Execution": true', '"Execution": yes')
    pattern, mended = load(tmp_path, text)
    assert pattern.frames[0].active == (1,)
    assert mended == (
        "line 1: the bare word yes was taken as text",
        "line 1: a comma before a closing bracket was left out",
    )


def test_text_that_looks_like_a_fault_is_left_alone(tmp_path: Path) -> None:
    content = '{"Note": "a, ] bare \\" word,}", "Pattern_Data": [%s],}'
    frame = json.dumps(kit_frame([1, 0]))
    _, mended = load(tmp_path, content % frame)
    assert mended == (
        "line 1: a comma before a closing bracket was left out",
        "Note was left out: frames carry their own values",
    )


def test_the_legacy_frequency_is_left_out_and_said(tmp_path: Path) -> None:
    text = spoiled(kit_pattern(kit_frame([1])), "{", '{"Frequency": 3, ')
    assert load(tmp_path, text)[1] == ("Frequency was left out: frames carry their own values",)


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        (kit_frame([1, 0, 1]), "it has 3 values, those before it have 2"),
        (kit_frame([1, 2]), r"pattern\[1\]: it says 2"),
        (kit_frame([1, True]), r"pattern\[1\]: it says true; give 0 or 1, not true or false"),
        (kit_frame([]), r"pattern: it says \[\]"),
        (kit_frame([1, 0], params={"frequency": 201, "stim_mode": 1}), "rate_hz: it says 201"),
        (kit_frame([1, 0], params={"frequency": 0, "stim_mode": 1}), "rate_hz: it says 0"),
        (kit_frame([1, 0], params={"frequency": 75, "stim_mode": 2}), "stim_mode: it says 2"),
        (kit_frame([1, 0], params={"frequency": 75}), "missing required field `stim_mode`"),
        (kit_frame([1, 0], delay={"ON": 0, "OFF": 0}), "duration_ms: it says 0"),
        (kit_frame([1, 0], delay={"ON": 30, "OFF": -1}), "off_ms: it says -1"),
        (kit_frame([1, 0], delay={"ON": 30}), "missing required field `OFF`"),
        (kit_frame([1, 0], sound=3), "unknown field `sound`"),
        (kit_frame([1, 0]) * 2, "it is no list of one frame"),
        ([], "it is no list of one frame"),
    ],
)
def test_a_frame_of_the_kit_that_cannot_be_understood_is_refused_by_its_number(
    tmp_path: Path, bad: list[dict[str, object]], sentence: str
) -> None:
    with pytest.raises(PatternError, match=sentence) as caught:
        load(tmp_path, kit_pattern(kit_frame([1, 0]), bad))
    assert caught.value.frame == 1


def test_a_pattern_of_the_kit_without_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PatternError, match="give at least one"):
        load(tmp_path, kit_pattern())


def test_a_layout_puts_each_electrode_on_the_output_that_its_mapping_names(tmp_path: Path) -> None:
    array, mended = load_layout(tmp_path)
    assert mended == ()
    assert array.outputs() == (2, 0, 1)
    assert array.x_mm == (-2.0, 0.0, 2.0)
    assert array.diameter_mm == 1.5
    assert array.name == "etactilekit-layout"


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"Mapping_func": None}, "Mapping_func is missing: electrode i"),
        ({"Mapping_func": [2, 0, 1, 3]}, "Mapping_func has 4 entries for 3 electrodes"),
        ({"electrode_radius": None}, "electrode_radius is missing: it was taken as 0.5 mm"),
        ({"Electrodes_Number": 4}, "Electrodes_Number says 4, the list has 3"),
        ({"electrodes": [{"x": 0, "y": 0, "z": 1}, {"x": 1, "y": 0}, {"x": 2, "y": 0}]}, "z was"),
    ],
)
def test_what_a_layout_leaves_open_is_assumed_and_said(
    tmp_path: Path, changes: dict[str, object], sentence: str
) -> None:
    array, mended = load_layout(tmp_path, **changes)
    assert array.count == 3
    assert len(mended) == 1
    assert mended[0].startswith(sentence)


def test_radii_that_differ_are_taken_as_the_smallest(tmp_path: Path) -> None:
    points = [{"x": x, "y": 0, "radius": radius} for x, radius in ((0, 1.0), (5, 0.75), (10, 1.2))]
    array, mended = load_layout(tmp_path, electrodes=points, electrode_radius=None)
    assert array.diameter_mm == 1.5
    assert mended == ("radii differ: all were taken as the smallest, 0.75 mm",)


def test_an_electrode_smaller_than_the_radius_of_all_makes_all_small(tmp_path: Path) -> None:
    points = [{"x": 0, "y": 0, "radius": 0.4}, {"x": 5, "y": 0}, {"x": 10, "y": 0}]
    assert load_layout(tmp_path, electrodes=points)[0].diameter_mm == 0.8


def test_a_bare_word_in_a_layout_is_mended_and_said(tmp_path: Path) -> None:
    text = json.dumps(LAYOUT | {"board": "on_board"})
    path = write(tmp_path, "layout.json", spoiled(text, '"on_board"', "on_board"))
    assert read_layout(path)[1] == ("line 1: the bare word on_board was taken as text",)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"Mapping_func": [0, 1]}, "Mapping_func: it has 2 entries for 3 electrodes"),
        ({"Mapping_func": [0, 1, 1]}, "output 1 belongs to electrode 1 as well"),
        ({"Mapping_func": [0, 1, 256]}, r"Mapping_func\[2\]: it says 256"),
        ({"Mapping_func": [0, 1, -1]}, r"Mapping_func\[2\]: it says -1"),
        ({"electrodes": [{"x": 0, "y": 0}] * 3}, "it is where electrode 0 is"),
        ({"electrodes": [{"x": 0, "y": 0}, {"x": 1}]}, r"electrodes\[1\].*missing required"),
        (
            {"electrodes": [{"x": 0, "y": 0}, {"x": "1", "y": 0}]},
            r"electrodes\[1\]\.x: it says '1'",
        ),
        (
            {"electrodes": [{"x": 0, "y": 0}, {"x": 900, "y": 0}]},
            r"electrodes\[1\]\.x: it says 900",
        ),
        ({"electrodes": [{"x": 0, "y": 0}]}, "electrodes: "),
        ({"electrode_radius": 0}, "electrode_radius: it says 0"),
    ],
)
def test_a_layout_that_cannot_be_understood_is_refused_by_key(
    tmp_path: Path, changes: dict[str, object], sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence):
        load_layout(tmp_path, **changes)


@real_files
@pytest.mark.parametrize(
    ("name", "electrodes", "frames", "duration_ms"),
    [
        ("pattern_spiral_arms_8", 8, 55, 10_900),
        ("pattern_fading_8", 8, 5, 2_150),
        ("pattern_sine_wave_64", 64, 76, 2_360),
    ],
)
def test_the_real_patterns_of_the_kit_are_read_without_a_mend(
    name: str, electrodes: int, frames: int, duration_ms: int
) -> None:
    path = ETACTILEKIT_DATA / f"{name}.json"
    pattern, mended = load_pattern(path)
    assert mended == ()
    assert (pattern.electrodes, len(pattern.frames)) == (electrodes, frames)
    assert pattern.duration_ms == duration_ms
    raw = json.loads(path.read_text(encoding="utf-8"))["Pattern_Data"]
    for frame, (original,) in zip(pattern.frames, raw, strict=True):
        assert list(frame.level) == original["pattern"]
        assert frame.rate_hz == original["params"]["frequency"]


@real_files
@pytest.mark.parametrize(
    ("name", "electrodes", "mends"),
    [("layout_main_board_8", 8, 0), ("layout_finger_pad_16", 16, 1), ("layout_64", 64, 1)],
)
def test_the_real_layouts_of_the_kit_are_read_and_a_missing_radius_is_said(
    name: str, electrodes: int, mends: int
) -> None:
    array, mended = read_layout(ETACTILEKIT_DATA / f"{name}.json")
    assert array.count == electrodes
    assert len(mended) == mends
