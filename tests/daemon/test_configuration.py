"""The configuration of a daemon: every key, every file it names, and the rules between them."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from etd.files.array import ARRAY_FOR_COUNT
from etd.files.calibration import load_calibration
from etd.files.configuration import LoadedConfig, fake_config, load_config
from etd.files.resources import find, names
from etd.protocol.errors import FileError
from etd_hal.boardfile import GUARDS, load_board, load_machine
from files_by_hand import ARRAY, CONFIG, DAEMON, LAYOUT, spoiled, write

BOARD = (CONFIG / "boards" / "reference-hv507.toml").read_text(encoding="utf-8")
MACHINE = (CONFIG / "machines" / "pi4.toml").read_text(encoding="utf-8")


def load(folder: Path, text: str) -> LoadedConfig:
    return load_config(write(folder, "etd.toml", text))


def test_the_shipped_configuration_loads_and_accepts_no_absent_guard() -> None:
    loaded = load_config(CONFIG / "etd.toml")
    assert loaded.config.backend == "linux"
    assert loaded.config.accept_absent_guards == ()
    assert loaded.unaccepted_guards == GUARDS


def test_accepted_guards_are_no_longer_missing(tmp_path: Path) -> None:
    accepted = [name for name in GUARDS if name != "heartbeat"]
    text = spoiled(DAEMON, "accept_absent_guards = []", f"accept_absent_guards = {accepted}")
    assert load(tmp_path, text).unaccepted_guards == ("heartbeat",)


def test_files_of_ones_own_lie_beside_the_configuration(tmp_path: Path) -> None:
    write(tmp_path, "strip.toml", ARRAY)
    text = spoiled(DAEMON, '"grid-8x8"', '"./strip.toml"')
    assert load(tmp_path, text).array.name == "strip-3"


def test_a_layout_of_another_kit_serves_as_array_and_what_was_mended_is_kept(
    tmp_path: Path,
) -> None:
    layout = {key: value for key, value in LAYOUT.items() if key != "electrode_radius"}
    write(tmp_path, "strip.json", msgspec.json.encode(layout).decode())
    loaded = load(tmp_path, spoiled(DAEMON, '"grid-8x8"', '"strip.json"'))
    assert loaded.array.outputs() == (2, 0, 1)
    assert [sentence.split(" ")[0] for sentence in loaded.mended] == ["electrode_radius"]


@pytest.mark.parametrize(
    "key",
    [
        "backend",
        "board",
        "machine",
        "array",
        "body_site",
        "accept_absent_guards",
        "operators",
        "core",
        "priority",
    ],
)
def test_every_key_is_required(tmp_path: Path, key: str) -> None:
    lines = DAEMON.splitlines(keepends=True)
    text = "".join(line for line in lines if not line.startswith(f"{key} = "))
    with pytest.raises(FileError, match=f"missing required field `{key}`"):
        load(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("backend =", "backnd =", r"unknown field `backnd`"),
        ('"fake"', '"fakee"', r"backend: it says 'fakee'"),
        ("operators = []", 'operators = []\ntcp = "tcp://*:5560"', r"tcp: .*has no keys.*over ssh"),
        ('"kajimoto-hv507"', '"kajimoto"', r"no 'kajimoto' among the shipped boards.*reference"),
        ('"pi4"', '"pi5"', r"no 'pi5' among the shipped machines.*pi3, pi4"),
        ('"grid-8x8"', '"./none.toml"', r"array: it says './none\.toml': there is no such file"),
        ('"grid-8x8"', '"grid-16x16"', r"electrode\[64\]\.output: it hangs on output 64"),
        ('"fingertip"', '"forearm"', r"body_site: forearm holds for electrodes of 3\.0 mm"),
        ("accept_absent_guards = []", 'accept_absent_guards = ["stop"]', r"no guard 'stop'"),
        ('"any"', "64", r"engine\.core: it says 64"),
        ('"none"', "99", r"engine\.priority: it says 99"),
        ("operators = []", 'operators = [""]', r"operators\[0\]: it says ''"),
        ("operators = []", 'operators = ["anna\\u001b[2J"]', r"operators\[0\]: it says 'anna"),
        ("operators = []", 'operators = ["anna\\n"]', r"operators\[0\]: it says 'anna"),
        ("operators = []", 'operators = ["anna b"]', r"operators\[0\]: it says 'anna b'"),
        ("[engine]", "[engine", "it is not TOML"),
        (
            '"kajimoto-hv507"',
            f'"./{"a" * 300}"',
            "board: .* text in quotes of 1 to 200 characters",
        ),
    ],
)
def test_a_spoiled_configuration_is_refused_by_key_and_value(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence):
        load(tmp_path, spoiled(DAEMON, old, new))


@pytest.mark.parametrize("wrong", ["kajimoto-hv506", "./mine.toml"])
def test_a_board_that_is_not_there_is_refused_by_the_file_and_key_that_name_it(
    tmp_path: Path, wrong: str
) -> None:
    with pytest.raises(FileError, match=f"it says '{wrong}': there is no ") as caught:
        load(tmp_path, spoiled(DAEMON, "kajimoto-hv507", wrong))
    assert (Path(caught.value.file).parent, caught.value.key) == (tmp_path, "board")
    assert "kajimoto-hv507" in caught.value.allowed


def test_a_guard_that_the_board_has_cannot_be_accepted_as_absent(tmp_path: Path) -> None:
    text = spoiled(DAEMON, "kajimoto-hv507", "reference-hv507")
    text = spoiled(text, "accept_absent_guards = []", 'accept_absent_guards = ["heartbeat"]')
    with pytest.raises(FileError, match=r"the board reference-hv507 has heartbeat"):
        load(tmp_path, text)


def test_a_site_whose_defaults_the_board_cannot_do_is_refused(tmp_path: Path) -> None:
    write(tmp_path, "weak.toml", spoiled(BOARD, "width_us = 200", "width_us = 60"))
    text = spoiled(DAEMON, "kajimoto-hv507", "./weak.toml")
    with pytest.raises(FileError, match=r"default width_us of fingertip is 100, .* allows 60"):
        load(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("CLK = 24", "CLK = 23", r"line 23: it is used for BL and for CLK"),
        ("emergency_stop = 17", "emergency_stop = 25", r"line 25: it is used for HV and"),
        ("line = 27", "line = 18", r"line 18: it is used for HEARTBEAT and for READBACK"),
        ("DATA = 5", "DATA = 26", r"DATA: line 26 is above CLK"),
        ("LE = 22", "LE = 26", r"LE: line 26 is above BL"),
        ("charge_nc = 2_000\n", "", "missing required field `charge_nc`"),
        ("current_ua = 10_000", "current_ua = 10_001", r"maxima\.current_ua: it says 10001"),
        ("emergency_stop = 17", "emergency_stpo = 17", "guards: "),
        ("divider = 100.0", "divider = nan", r"divider: it says nan"),
        ("divider = 100.0", "divider = inf", r"divider: it says inf"),
    ],
)
def test_a_spoiled_board_is_refused_by_key_and_value(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence):
        load_board(write(tmp_path, "board.toml", spoiled(BOARD, old, new)))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("halt_excess_us = 300.0", "halt_excess_us = inf", "halt_excess_us: it says inf"),
        ("halt_excess_us = 300.0", "halt_excess_us = nan", "halt_excess_us: it says nan"),
        ("high = 24.0", "high = inf", r"word_us\.high: it says inf"),
        ("high = 24.0", "high = 11.0", r"word_us: low 12\.0 is above high 11\.0"),
        ("guard_word_us = 26.0\n", "", "missing required field `guard_word_us`"),
    ],
)
def test_a_spoiled_machine_is_refused_by_key_and_value(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(FileError, match=sentence):
        load_machine(write(tmp_path, "machine.toml", spoiled(MACHINE, old, new)))


@pytest.mark.parametrize("count", ARRAY_FOR_COUNT)
def test_the_fake_finds_board_array_and_calibration_for_a_count_of_electrodes(count: int) -> None:
    loaded = fake_config(electrodes=count)
    assert loaded.config.backend == "fake"
    assert loaded.array.count == count
    assert loaded.board.name == ("kajimoto-hv507" if count <= 64 else "etactilekit-hv513-x8")
    assert loaded.unaccepted_guards == ()
    assert loaded.config.default_calibration is not None
    calibration = load_calibration(find("calibrations", loaded.config.default_calibration))
    assert (calibration.array, calibration.body_site) == (loaded.array.name, "fingertip")
    assert len(calibration.electrode) == count


@pytest.mark.parametrize("board", names("boards"))
def test_the_fake_fills_the_outputs_of_any_board_that_is_named(board: str) -> None:
    loaded = fake_config(board=board)
    assert loaded.array.count == loaded.board.switch.outputs


def test_the_fake_without_a_word_is_the_kit_with_64_electrodes() -> None:
    loaded = fake_config()
    assert (loaded.board.name, loaded.array.name) == ("kajimoto-hv507", "grid-8x8")
    assert loaded.config.default_calibration == "fake-fingertip"


def test_the_fake_offers_no_calibration_for_an_array_it_was_not_made_on(tmp_path: Path) -> None:
    path = write(tmp_path, "strip.toml", ARRAY)
    loaded = fake_config(array=str(path))
    assert loaded.array.name == "strip-3"
    assert loaded.config.default_calibration is None


def test_a_count_that_no_array_has_is_refused() -> None:
    with pytest.raises(FileError, match="no shipped array has 7 electrodes"):
        fake_config(electrodes=7)
