"""The sheet of an array: every electrode at its place and in its true size, from both sides."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from drawn_svg import Box, Drawing
from etd.draw.array_sheet import READABLE_MM, array_sheet
from etd.files.array import Array, Electrode, PressureSensor, load_array
from etd.files.etactilekit import read_layout
from files_by_hand import ARRAY, CONFIG, ETACTILEKIT_DATA, REPOSITORY, write

pytestmark = pytest.mark.slow

SHIPPED = sorted((CONFIG / "arrays").glob("*.toml"))
#: A4 and Letter less the 10 mm that browsers leave on each side.
ON_PAPER = (190.0, 259.0)
#: How exactly a length is written.
EXACT = 0.0011


def made(
    places: list[tuple[float, float]], diameter_mm: float = 1.0, outputs: list[int] | None = None,
    pressure: tuple[PressureSensor, ...] = (), mark: str = "a corner", title: str = "made",
) -> Array:  # fmt: skip
    given = outputs or list(range(len(places)))
    return Array(
        name="made",
        title=title,
        view="through-finger",
        mark=mark,
        diameter_mm=diameter_mm,
        electrode=tuple(
            Electrode(x_mm=x, y_mm=y, output=output)
            for (x, y), output in zip(places, given, strict=True)
        ),
        pressure=pressure,
    )


def sensor(x_mm: float, y_mm: float, channel: int) -> PressureSensor:
    return PressureSensor(
        address=0x48, channel=channel, x_mm=x_mm, y_mm=y_mm, zero_v=0.5, kpa_per_v=100.0,
        low_v=0.3, high_v=3.0,
    )  # fmt: skip


tenths = st.integers(-300, 300).map(lambda it: it / 10)


@st.composite
def arrays(draw: st.DrawFn) -> Array:
    places = draw(st.lists(st.tuples(tenths, tenths), min_size=2, max_size=30, unique=True))
    outputs = draw(st.lists(st.integers(0, 255), min_size=30, max_size=30, unique=True))
    return made(places, draw(st.integers(1, 50)) / 10, outputs[: len(places)])


def drawn(array: Array, notes: tuple[str, ...] = ()) -> Drawing:
    return Drawing(array_sheet(array, notes).svg)


def scales(drawing: Drawing, side: str) -> list[int]:
    return [scale for scale in range(1, 11) if f"{side}-{scale}-electrode-0" in drawing]


def check_side(drawing: Drawing, array: Array, side: str, scale: int) -> None:
    across = -scale if side == "mirrored" else scale
    first_x, first_y, _ = drawing.circle(f"{side}-{scale}-electrode-0")
    first = array.electrode[0]
    for index, electrode in enumerate(array.electrode):
        x, y, radius = drawing.circle(f"{side}-{scale}-electrode-{index}")
        assert 2 * radius == pytest.approx(array.diameter_mm * scale, abs=EXACT)
        assert x - first_x == pytest.approx((electrode.x_mm - first.x_mm) * across, abs=EXACT)
        assert y - first_y == pytest.approx((first.y_mm - electrode.y_mm) * scale, abs=EXACT)
        assert drawing.text(f"{side}-{scale}-number-{index}") == str(index)


@given(arrays())
@settings(max_examples=40, deadline=None)
def test_every_electrode_is_at_its_place_in_true_size_from_both_sides(array: Array) -> None:
    drawing = drawn(array)
    drawing.check_on_paper()
    for side in ("skin", "mirrored"):
        found = scales(drawing, side)
        assert found[0] == 1
        for scale in found:
            check_side(drawing, array, side, scale)


@given(arrays())
@settings(max_examples=40, deadline=None)
def test_every_output_is_written_in_the_largest_picture(array: Array) -> None:
    drawing = drawn(array)
    for side in ("skin", "mirrored"):
        largest = scales(drawing, side)[-1]
        for index, output in enumerate(array.outputs()):
            mark = f"{side}-{largest}-output-{index}"
            if mark in drawing:
                assert drawing.text(mark) == str(output)
            else:
                assert "too near to one another" in drawing.words()


@given(arrays())
@settings(max_examples=60, deadline=None)
def test_no_number_lies_on_another(array: Array) -> None:
    assert drawn(array).overlapping() == []


@given(arrays())
@settings(max_examples=40, deadline=None)
def test_no_number_lies_on_the_circle_of_another_electrode(array: Array) -> None:
    """Where the electrodes themselves do not lie on one another."""
    drawing = drawn(replace(array, diameter_mm=min(array.diameter_mm, 0.95 * array.pitch_mm())))
    boxes = {box.what: box for box in drawing.boxes()}
    for side in ("skin", "mirrored"):
        for scale in scales(drawing, side):
            circles = [
                drawing.circle(f"{side}-{scale}-electrode-{index}") for index in range(array.count)
            ]
            for index in range(array.count):
                for kind in ("number", "output"):
                    box = boxes.get(f"{side}-{scale}-{kind}-{index}")
                    on = [it for it, circle in enumerate(circles) if box and touches(box, *circle)]
                    assert set(on) <= {index}


def touches(box: Box, x: float, y: float, radius: float) -> bool:
    across = max(box.left - x, 0.0, x - box.right)
    return math.hypot(across, max(box.top - y, 0.0, y - box.bottom)) < radius - EXACT


def test_a_grid_is_as_wide_on_paper_as_it_is() -> None:
    """A rule of thumb with which a mistake in the scale shows: 1 mm wide, 2.5 mm apart."""
    drawing = drawn(load_array(CONFIG / "arrays" / "grid-8x8.toml"))
    x, y, radius = drawing.circle("skin-1-electrode-0")
    beside = drawing.circle("skin-1-electrode-1")
    assert radius == 0.5
    assert beside[0] - x == pytest.approx(2.5)
    assert beside[1] == y


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_array_is_readable_and_fits_on_paper(path: Path) -> None:
    array = load_array(path)
    drawing = drawn(array)
    drawing.check_on_paper()
    assert drawing.overlapping() == []
    assert drawing.width <= ON_PAPER[0]
    assert drawing.height <= ON_PAPER[1]
    assert "larger than a page" not in drawing.words()
    assert "too near to one another" not in drawing.words()
    largest = scales(drawing, "skin")[-1]
    for kind in ("number", "output"):
        size_mm = drawing.marks[f"skin-{largest}-{kind}-{array.count - 1}"].attrib["font-size"]
        assert float(size_mm) >= READABLE_MM


def test_the_picture_in_the_documentation_is_that_of_the_file() -> None:
    kept = (REPOSITORY / "docs" / "plots" / "pad-8.svg").read_text(encoding="utf-8")
    assert kept == array_sheet(load_array(CONFIG / "arrays" / "pad-8.toml")).svg, (
        "remove it, then: etd check --draw docs/plots/pad-8.svg config/arrays/pad-8.toml"
    )


def test_the_sides_are_told_apart_and_the_fingertip_is_up() -> None:
    drawing = drawn(load_array(CONFIG / "arrays" / "pad-8.toml"))
    words = drawing.words()
    assert "Seen from the skin, 1 : 1" in words
    assert "Mirrored, 1 : 1" in words
    assert words.splitlines().count("to the fingertip") == 2
    # Of pad-8, 0 and 1 are nearest to the fingertip, 0 on the left as the file has it.
    assert drawing.circle("skin-1-electrode-0")[1] < drawing.circle("skin-1-electrode-7")[1]
    assert drawing.circle("skin-1-electrode-0")[0] < drawing.circle("skin-1-electrode-1")[0]
    assert drawing.circle("mirrored-1-electrode-0")[0] > drawing.circle("mirrored-1-electrode-1")[0]


def test_the_bar_is_ten_millimetres_long_and_says_so() -> None:
    drawing = drawn(load_array(CONFIG / "arrays" / "pad-8.toml"))
    bar = drawing.marks["ruler-10-mm"].attrib
    assert float(bar["x2"]) - float(bar["x1"]) == 10.0
    assert bar["y1"] == bar["y2"]
    assert "This bar is 10 mm long: check it with a ruler." in drawing.words()


def test_numbers_and_outputs_are_told_apart_without_color(tmp_path: Path) -> None:
    drawing = drawn(load_array(write(tmp_path, "a.toml", ARRAY)))
    assert drawing.text("skin-1-number-2") == "2"
    assert drawing.text("skin-1-output-2") == "7"
    assert drawing.marks["skin-1-number-2"].get("font-weight") == "700"
    assert drawing.marks["skin-1-output-2"].get("font-style") == "italic"
    assert "upright and bold: the number of the electrode" in drawing.words()
    assert "slanted: its output in the switch chain" in drawing.words()
    assert "Electrode 0 (filled): left end" in drawing.words()


def test_letters_keep_clear_of_circles_in_true_size_where_they_can_be_read() -> None:
    """The sheet is laid under the array, whose electrodes must be seen."""
    drawing = drawn(load_array(CONFIG / "arrays" / "grid-16x16.toml"))
    boxes = {box.what: box for box in drawing.boxes()}
    for index in range(256):
        _, y, radius = drawing.circle(f"skin-1-electrode-{index}")
        for other in (index, index + 16):
            box = boxes.get(f"skin-1-number-{other}")
            assert box is None or box.top > y + radius or box.bottom < y - radius


def test_pressure_sensors_have_a_mark_and_a_name_each() -> None:
    places = [(-2.0, 0.0), (0.0, 0.0), (2.0, 0.0)]
    pressure = tuple(sensor(x, 0.0, channel) for channel, x in enumerate((-1.0, 0.0, 1.0)))
    drawing = drawn(made(places, pressure=pressure))
    assert drawing.overlapping() == []
    words = drawing.words()
    for number in range(3):
        assert f"skin-1-pressure-{number}" in drawing
        assert f"mirrored-1-pressure-{number}" in drawing
        assert f"P{number}: pressure sensor, ADS1115 at 0x48, input {number}" in words
    corners = [
        float(point.partition(",")[0])
        for point in drawing.marks["skin-1-pressure-2"].attrib["points"].split()
    ]
    middle, _, _ = drawing.circle("skin-1-electrode-1")
    assert (min(corners) + max(corners)) / 2 - middle == pytest.approx(1.0, abs=EXACT)


def test_electrodes_too_near_for_any_paper_are_told() -> None:
    drawing = drawn(made([(0.0, 0.0), (0.01, 0.0), (400.0, 400.0)]))
    assert "too near to one another" in drawing.words()
    drawing.check_on_paper()
    assert drawing.width > 400
    assert "This sheet is larger than a page" in drawing.words()


def test_the_least_distance_that_can_be_written_breaks_nothing() -> None:
    drawn(made([(0.0, 0.0), (5e-324, 0.0)], diameter_mm=100.0)).check_on_paper()


def test_what_was_assumed_is_on_the_sheet() -> None:
    drawing = drawn(made([(0.0, 0.0), (2.0, 0.0)]), ("its radius was taken as 0.5 mm",))
    assert "Note: its radius was taken as 0.5 mm" in drawing.words()


@pytest.mark.parametrize(
    "title",
    ["<script>alert(1)</script>", "a & b ]]> \"c\" 'd'", "\x00\x1b[2J\u202e\ufffe", "x" * 100_000],
)
def test_no_title_leaves_its_place(title: str) -> None:
    drawing = drawn(made([(0.0, 0.0), (2.0, 0.0)], title=title, mark=title))
    drawing.check_on_paper()
    assert drawing.height <= ON_PAPER[1]


@pytest.mark.parametrize("name", ["layout_main_board_8", "layout_finger_pad_16", "layout_64"])
def test_a_layout_of_another_kit_is_drawn(name: str) -> None:
    path = ETACTILEKIT_DATA / f"{name}.json"
    if not path.exists():
        pytest.skip("eTactileKit's own files are not beside this checkout")
    array, notes = read_layout(path)
    drawing = drawn(array, notes)
    drawing.check_on_paper()
    assert drawing.overlapping() == []
    check_side(drawing, array, "mirrored", 1)
