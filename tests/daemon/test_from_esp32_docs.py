"""docs/from-esp32-kits.md: its pictures, its wires and its files, against the program.

Owns: that each is what the program draws or reads. Its commands are run by `tests/system`.
Must not know: daemons.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from drawn_svg import Drawing
from etd.cli import main
from etd.draw.board_sheet import board_sheet
from etd.draw.header import wires_of
from etd_hal.boardfile import load_board
from screenshots import PLOTS, demo_svg

REPOSITORY = Path(__file__).parents[2]
PAGE = (REPOSITORY / "docs" / "from-esp32-kits.md").read_text(encoding="utf-8")
BOARDS = REPOSITORY / "config" / "boards"
KITS = [
    "kajimoto-hv507",
    "etactilekit-hv513",
    "etactilekit-hv513-x2",
    "etactilekit-hv513-x8",
]
#: How each row of the table begins, and the wire of the board file that it is.
NAMES = {
    "POL": "POL",
    "DATA": "DATA",
    "LE": "LE",
    "BL": "BL",
    "CLK": "CLK",
    "data into the DAC": "SPI0 MOSI",
    "data out of the ADC": "SPI0 MISO",
    "clock of both": "SPI0 SCLK",
    "both chip selects": "SPI0 CE0",
    "SYNC": "SYNC",
    "TRIGGER": "TRIGGER",
}


def kept(name: str) -> str:
    return (PLOTS / name).read_text(encoding="utf-8")


def spans(svg: str) -> list[tuple[str, str]]:
    """Every piece of text with its color: what is on the screen, however a library writes it."""
    colors = dict(re.findall(r"\.(etd-r\d+) \{ ([^}]*) \}", svg))
    found = re.findall(r'<text class="(etd-r\d+)"[^>]*>([^<]*)</text>', svg)
    return [(colors[name], text) for name, text in found]


def test_the_picture_of_the_terminal_is_what_the_demo_draws_of_these_reports() -> None:
    drawn = spans(demo_svg())
    assert "delivered" in " ".join(text for _, text in drawn)
    assert drawn == spans(kept("demo.svg")), "run: python tests/screenshots.py"


def test_the_picture_of_the_terminal_needs_nothing_from_elsewhere() -> None:
    assert re.findall(r"https?://[^\s\"]+", kept("demo.svg")) == ["http://www.w3.org/2000/svg"]
    assert "<script" not in kept("demo.svg")


def test_the_picture_of_the_header_is_that_of_the_shipped_board() -> None:
    board = load_board(BOARDS / "etactilekit-hv513.toml")
    assert kept("etactilekit-hv513.svg") == board_sheet(board).svg, (
        "remove it, then: etd check --draw docs/plots/etactilekit-hv513.svg"
        " config/boards/etactilekit-hv513.toml"
    )


def test_the_picture_of_the_pattern_is_that_of_the_file_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rows.json").write_text(block("Pattern_Data"))
    assert main(["check", "--draw", "rows.svg", "rows.json"]) == 0
    drawn = Path("rows.svg").read_text(encoding="utf-8")
    assert Drawing(drawn).marks
    assert drawn == kept("kit-pattern.svg"), (
        "save the page's rows.json, then: etd check --draw docs/plots/kit-pattern.svg rows.json"
    )


def block(word: str) -> str:
    (found,) = [text for text in re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL) if word in text]
    return str(found)


@pytest.mark.parametrize("kit", KITS)
def test_the_table_of_wires_is_the_board_file_of_each_kit(kit: str) -> None:
    rows = re.findall(r"^\| ([^|]+) \| (\d+) \| (\d+) \|$", PAGE, re.MULTILINE)
    wires = wires_of(load_board(BOARDS / f"{kit}.toml"))
    assert {(int(gpio), int(pin)) for _, gpio, pin in rows} == {
        (wire.gpio, wire.pin) for wire in wires
    }
    line_of = {wire.name: wire.gpio for wire in wires}
    assert len(rows) == len(NAMES)
    for (what, gpio, _), (begins, name) in zip(rows, NAMES.items(), strict=True):
        assert what.replace("*", "").startswith(begins)
        assert line_of[name] == int(gpio)
