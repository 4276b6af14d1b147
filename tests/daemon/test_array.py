"""Arrays: the rules of the file, and what follows from the geometry."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.files.array import ARRAY_FOR_COUNT, Array, array_for_count, check_fits, load_array
from etd.protocol.errors import FileError
from files_by_hand import ARRAY, CONFIG, spoiled, write

GRID = load_array(CONFIG / "arrays" / "grid-8x8.toml")


def load(folder: Path, text: str) -> Array:
    return load_array(write(folder, "array.toml", text))


@pytest.mark.parametrize("path", sorted((CONFIG / "arrays").glob("*.toml")), ids=lambda p: p.stem)
def test_every_shipped_array_loads_under_its_own_name(path: Path) -> None:
    assert load_array(path).name == path.stem


@pytest.mark.parametrize("count", ARRAY_FOR_COUNT)
def test_the_array_for_a_count_has_so_many_electrodes(count: int) -> None:
    path = CONFIG / "arrays" / f"{array_for_count(count)}.toml"
    assert load_array(path).count == count


def test_a_count_without_an_array_is_refused_with_the_counts_there_are() -> None:
    with pytest.raises(FileError, match=r"no shipped array has 9 electrodes.*8, 16, 32"):
        array_for_count(9)


def test_an_electrode_hangs_on_the_output_of_its_index_unless_the_file_says_otherwise(
    tmp_path: Path,
) -> None:
    assert load(tmp_path, ARRAY).outputs() == (0, 1, 7)


def test_electrode_zero_of_a_grid_is_at_the_upper_left_and_y_rises_towards_the_fingertip() -> None:
    first, second, below = GRID.electrode[0], GRID.electrode[1], GRID.electrode[8]
    assert (second.x_mm - first.x_mm, second.y_mm - first.y_mm) == (2.5, 0.0)
    assert (below.x_mm - first.x_mm, below.y_mm - first.y_mm) == (0.0, -2.5)
    assert first.x_mm == min(GRID.x_mm)
    assert first.y_mm == max(GRID.y_mm)


def test_the_hexagon_gives_its_center_six_neighbors_at_one_distance() -> None:
    hexagon = load_array(CONFIG / "arrays" / "hexagon-61.toml")
    center = 30
    assert (hexagon.electrode[center].x_mm, hexagon.electrode[center].y_mm) == (0.0, 0.0)
    assert hexagon.neighbors(center) == (21, 22, 29, 31, 38, 39)
    distances_mm = [hexagon.distance_mm(center, other) for other in hexagon.neighbors(center)]
    assert distances_mm == pytest.approx([2.0] * 6, abs=0.001)


def test_a_ring_holds_the_electrodes_within_a_quarter_of_its_radius() -> None:
    # From electrode 27 of the grid: 2.5 mm along the axes; 3.54 mm on the diagonals is outside
    # 2.5 mm plus a quarter, and inside 5 mm less a quarter only from 3.75 mm on.
    assert GRID.ring(27, 2.5) == (19, 26, 28, 35)
    assert GRID.ring(27, 5.0) == (10, 11, 12, 17, 21, 25, 29, 33, 37, 42, 43, 44)


def test_a_ring_of_which_nobody_is_a_member_is_empty() -> None:
    assert GRID.ring(0, 90.0) == ()


def test_neighbors_in_a_corner_of_a_grid_are_two() -> None:
    assert GRID.neighbors(0) == (1, 8)


@given(electrode=st.integers(0, 63), ring_mm=st.floats(0.5, 40.0))
def test_membership_of_a_ring_is_mutual_and_never_of_oneself(
    electrode: int, ring_mm: float
) -> None:
    ring = GRID.ring(electrode, ring_mm)
    assert electrode not in ring
    assert all(electrode in GRID.ring(other, ring_mm) for other in ring)


@given(a=st.integers(0, 63), b=st.integers(0, 63), c=st.integers(0, 63))
def test_distances_are_those_of_a_plane(a: int, b: int, c: int) -> None:
    assert GRID.distance_mm(a, b) == GRID.distance_mm(b, a)
    assert (GRID.distance_mm(a, b) == 0.0) == (a == b)
    assert GRID.distance_mm(a, c) <= GRID.distance_mm(a, b) + GRID.distance_mm(b, c) + 1e-9


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("x_mm = 0.0", "x_mm = nan", r"electrode\[1\]\.x_mm: it says nan"),
        ("x_mm = 0.0", "x_mm = inf", r"electrode\[1\]\.x_mm: it says inf"),
        ("x_mm = 0.0", "x_mm = -2.0", r"electrode\[1\]: it is where electrode 0 is"),
        ("x_mm = 0.0", "x_mm = -1.91", r"electrode\[1\]: it is 0.09 mm from electrode 0"),
        ("output = 7", "output = 1", r"electrode\[2\].output: output 1 belongs to electrode 1"),
        ("output = 7", "output = 256", r"electrode\[2\]\.output: it says 256"),
        ("output = 7", "outptu = 7", "unknown field `outptu`"),
        ("through-finger", "from-below", "view: it says 'from-below'"),
        ('mark = "left end"', 'mark = ""', "mark: it says ''"),
        ('mark = "left end"\n', "", "missing required field `mark`"),
        ("diameter_mm = 1.0", "diameter_mm = nan", "diameter_mm: it says nan"),
        ("diameter_mm = 1.0", 'diameter_mm = "1"', "diameter_mm: it says '1'"),
    ],
)
def test_a_spoiled_array_is_refused_by_key_and_value(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence) as caught:
        load(tmp_path, spoiled(ARRAY, old, new))
    assert caught.value.file == str(tmp_path / "array.toml")


def test_an_array_that_is_too_large_for_the_board_is_refused_by_electrode(tmp_path: Path) -> None:
    array = load(tmp_path, ARRAY)
    check_fits(array, 8, "etd.toml")
    with pytest.raises(FileError, match=r"electrode\[2\]\.output: it hangs on output 7, .* has 7"):
        check_fits(array, 7, "etd.toml")
