"""The header of a board: every wire at its pin, every pull, every guard."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from drawn_svg import Drawing
from etd.draw.board_sheet import board_sheet
from etd.draw.header import PIN_OF_GPIO, POWER_PINS, wires_of
from etd_hal.boardfile import GUARDS, BoardFile, EdgeInput, load_board
from files_by_hand import CONFIG, REPOSITORY, spoiled, write

SHIPPED = sorted((CONFIG / "boards").glob("*.toml"))
REFERENCE = (CONFIG / "boards" / "reference-hv507.toml").read_text(encoding="utf-8")
HARDWARE = (REPOSITORY / "docs" / "hardware.md").read_text(encoding="utf-8")
#: Function, GPIO lines and pins, pull at boot, level wanted: of "The lines".
TABLE = re.findall(r"^\| ([^|]+?) \| ([\d, ]+) \| ([\d, ]+) \| (\w+) \| ([^|]+) \|", HARDWARE, re.M)


def numbers(text: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", text)]


def drawn(board: BoardFile) -> Drawing:
    return Drawing(board_sheet(board).svg)


def of_text(tmp_path: Path, *changes: tuple[str, str]) -> Drawing:
    text = REFERENCE
    for old, new in changes:
        text = spoiled(text, old, new)
    return drawn(load_board(write(tmp_path, "board.toml", text)))


def is_pull_up(drawing: Drawing, pin: int) -> bool:
    """By the one corner that is alone at its height: the tip."""
    points = drawing.marks[f"pull-{pin}"].attrib["points"].split()
    heights = sorted(float(point.partition(",")[2]) for point in points)
    return heights[1] == heights[2]


def test_the_pins_are_those_of_the_table_in_the_documentation() -> None:
    assert len(TABLE) == 15
    for _, lines, pins, _, _ in TABLE:
        assert [PIN_OF_GPIO[line] for line in numbers(lines)] == numbers(pins)
    found = re.search(r"^Ground is on pins (.*)\.$", HARDWARE, re.M)
    assert found is not None
    assert [pin for pin, what in POWER_PINS.items() if what == "GND"] == numbers(found[1])


def test_forty_pins_are_28_lines_and_12_of_power() -> None:
    assert sorted(PIN_OF_GPIO) == list(range(28))
    assert sorted([*PIN_OF_GPIO.values(), *POWER_PINS]) == list(range(1, 41))
    assert sorted(POWER_PINS.values()) == ["3.3 V"] * 2 + ["5 V"] * 2 + ["GND"] * 8


def test_levels_and_pulls_are_those_of_the_table_in_the_documentation() -> None:
    wires = {wire.gpio: wire for wire in wires_of(load_board(CONFIG / "boards" / SHIPPED[-1].name))}
    assert SHIPPED[-1].stem == "reference-hv507"
    for function, lines, _, at_boot, wanted in TABLE:
        for line in numbers(lines):
            wire = wires[line]
            assert f"Pi at boot: {at_boot}" in wire.pull
            if "pull-up" in wanted:
                assert (wire.level, wire.is_fitted) == (1, True)
            elif "pull-down" in wanted or function == "HV ENABLE":
                assert (wire.level, wire.is_fitted) == (0, True)
            elif wanted.strip() == "0":
                assert (wire.level, wire.is_fitted) == (0, False)
            else:
                assert not wire.is_fitted


def test_the_picture_in_the_documentation_is_that_of_the_file() -> None:
    kept = (REPOSITORY / "docs" / "plots" / "reference-hv507.svg").read_text(encoding="utf-8")
    assert kept == board_sheet(load_board(SHIPPED[-1])).svg, (
        "remove it, then: etd check --draw docs/plots/reference-hv507.svg"
        " config/boards/reference-hv507.toml"
    )


def test_a_button_of_the_wearers_is_drawn_with_its_level_at_rest() -> None:
    board = msgspec.structs.replace(
        load_board(SHIPPED[-1]), too_strong=EdgeInput(line=6, edge="falling")
    )
    drawing = drawn(board)
    assert drawing.overlapping() == []
    assert drawing.text(f"pin-{PIN_OF_GPIO[6]}-name").startswith("TOO_STRONG: GPIO 6, into the Pi")
    (wire,) = [wire for wire in wires_of(board) if wire.name == "TOO_STRONG"]
    assert wire.level == 1


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_line_of_a_shipped_board_is_at_its_pin(path: Path) -> None:
    board = load_board(path)
    drawing = drawn(board)
    drawing.check_on_paper()
    assert drawing.overlapping() == []
    assert drawing.width == 190.0
    assert drawing.height <= 259.0  # of Letter, less what browsers leave free
    for name, line in board.used_lines().items():
        pin = PIN_OF_GPIO[line]
        assert drawing.text(f"pin-{pin}-name").startswith(f"{name}: GPIO {line}, ")
        assert f"wire-{pin}" in drawing
    for name, pin in (("SCLK", 23), ("MOSI", 19), ("MISO", 21), ("CE0", 24)):
        assert drawing.text(f"pin-{pin}-name").startswith(f"SPI0 {name}: ")
    wired = {wire.pin for wire in wires_of(board)}
    for pin in range(1, 41):
        assert (f"wire-{pin}" in drawing) == (pin in wired)
        assert drawing.text(f"pin-{pin}-number") == str(pin)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_guard_of_a_shipped_board_is_told_as_present_or_absent(path: Path) -> None:
    board = load_board(path)
    drawing = drawn(board)
    assert drawing.words().count("absent: arming is refused") == len(board.absent_guards)
    for name in GUARDS:
        assert (drawing.fill(f"guard-{name}") == "#FFFFFF") == (name in board.absent_guards)


def test_the_rows_are_those_of_the_header_and_pin_1_is_square() -> None:
    drawing = drawn(load_board(SHIPPED[-1]))
    assert drawing.marks["pin-1"].tag.endswith("rect")
    for pin in range(3, 41, 2):
        x, y, _ = drawing.circle(f"pin-{pin}")
        beside, level, _ = drawing.circle(f"pin-{pin + 1}")
        assert beside > x
        assert level == y
        if pin > 3:
            above = drawing.circle(f"pin-{pin - 2}")
            assert above[0] == x
            assert above[1] < y


def test_a_wire_ends_at_its_pin_on_the_side_of_its_name() -> None:
    drawing = drawn(load_board(SHIPPED[-1]))
    for wire in wires_of(load_board(SHIPPED[-1])):
        x, y, radius = drawing.circle(f"pin-{wire.pin}")
        line = drawing.marks[f"wire-{wire.pin}"].attrib
        assert abs(float(line["x1"]) - x) == pytest.approx(radius)
        assert float(line["y1"]) == float(line["y2"]) == y
        assert (float(line["x2"]) > x) == (wire.pin % 2 == 0)


def test_pulls_point_where_they_pull() -> None:
    drawing = drawn(load_board(SHIPPED[-1]))
    assert is_pull_up(drawing, 7)  # POL
    assert is_pull_up(drawing, 24)  # CE0
    for pin in (16, 22, 11, 36):  # BL, HV, both stops
        assert not is_pull_up(drawing, pin)
    assert "pull-29" not in drawing  # DATA: any level


def test_a_supply_that_a_low_level_switches_on_is_pulled_up(tmp_path: Path) -> None:
    drawing = of_text(tmp_path, ("line = 25, on = 1", "line = 25, on = 0"))
    assert is_pull_up(drawing, 22)
    assert "the high-voltage supply: 0 switches it on" in drawing.words()
    # GPIO 25 is pulled down at boot, which would switch it on.
    assert "HV: at boot the Pi pulls GPIO 25 to 0" in drawing.words()


def test_no_warning_of_pulls_is_given_where_there_is_no_cause(tmp_path: Path) -> None:
    assert "at boot the Pi pulls" not in of_text(tmp_path).words()
    assert (
        "POL: at boot the Pi pulls GPIO 21 to 0"
        in of_text(tmp_path, ("POL = 4", "POL = 21")).words()
    )


def test_unused_pins_are_grey_and_what_a_bus_holds_is_left_free(tmp_path: Path) -> None:
    drawing = of_text(tmp_path)
    assert drawing.fill("pin-37") == "#E4E4E4"
    assert drawing.text("pin-37-name") == "GPIO 26"
    assert drawing.text("pin-26-name") == "GPIO 7: held by SPI0, leave it free"
    assert drawing.text("pin-27-name") == "GPIO 0: leave it free"
    other = of_text(tmp_path, ("spidev0.0", "spidev0.1"))
    assert other.text("pin-26-name").startswith("SPI0 CE1: GPIO 7")
    assert other.text("pin-24-name") == "GPIO 8: held by SPI0, leave it free"


def test_a_bus_whose_pins_are_not_known_is_told_and_never_guessed(tmp_path: Path) -> None:
    drawing = of_text(tmp_path, ("/dev/spidev0.0", "/dev/spidev5.0"), ("/dev/i2c-1", "/dev/i2c-20"))
    assert "/dev/spidev5.0: its pins are not known here" in drawing.words()
    assert "/dev/i2c-20: its pins are not known here" in drawing.words()
    assert "SPI0" not in drawing.words()
    assert "I2C1" not in drawing.words()


def test_the_details_of_guards_are_those_of_the_file(tmp_path: Path) -> None:
    words = of_text(tmp_path).words()
    assert "GPIO 17 on pin 11: open, 0 or unplugged is a stop; a second contact breaks" in words
    assert (
        "ADS1115 at 0x48, input 0, behind a divider of 100: 280 to 320 V, off below 30 V" in words
    )
    assert "GPIO 27 on pin 13: no edge for 20 ms takes the supply away" in words
    assert "ends a pulse after 250 us" in words
    assert "ADS1115 at 0x48, MCP4725 at 0x60" in words
    alone = of_text(tmp_path, ("[guards]", "[guards]\nstop_cuts_supply = false"))
    assert "NO second contact breaks the supply" in alone.words()
