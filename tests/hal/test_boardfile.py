"""Board files: what is shipped, lines, switch, and the form of a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_rig import MACHINES
from etd_hal.boardfile import GUARDS, load_board, load_machine
from etd_hal.errors import FileError
from files_by_hand import spoiled, write
from spoiled_boards import HV513, KIT, REFERENCE, RELAYS, refused
from stepped_board import BOARDS


class TestShipped:
    @pytest.mark.parametrize("path", sorted(BOARDS.glob("*.toml")), ids=lambda path: path.stem)
    def test_every_board_loads_under_its_own_name(self, path: Path) -> None:
        assert load_board(path).name == path.stem

    @pytest.mark.parametrize("path", sorted(MACHINES.glob("*.toml")), ids=lambda path: path.stem)
    def test_every_machine_loads_under_its_own_name(self, path: Path) -> None:
        assert load_machine(path).name == path.stem

    def test_the_kit_has_no_guard_and_the_reference_has_all(self) -> None:
        kit, reference = (
            load_board(BOARDS / f"{name}.toml") for name in ("kajimoto-hv507", "reference-hv507")
        )
        assert (kit.absent_guards, kit.present_guards) == (GUARDS, ())
        assert (reference.absent_guards, reference.present_guards) == ((), GUARDS)

    @pytest.mark.parametrize("path", sorted(BOARDS.glob("*.toml")), ids=lambda path: path.stem)
    def test_sync_and_trigger_are_on_the_same_pins_of_every_board(self, path: Path) -> None:
        used = load_board(path).used_lines()
        assert (used["SYNC"], used["TRIGGER"]) == (12, 13)

    def test_lines_are_told_by_function(self) -> None:
        assert load_board(BOARDS / "reference-hv507.toml").used_lines() == {
            "POL": 4, "DATA": 5, "LE": 22, "BL": 23, "CLK": 24, "HV": 25, "HEARTBEAT": 27,
            "READBACK": 18, "EMERGENCY_STOP": 17, "WEARER_STOP": 16, "SYNC": 12, "TRIGGER": 13,
        }  # fmt: skip

    @pytest.mark.parametrize(
        ("text", "chip"), [(KIT, "HV507"), (HV513, "HV513"), (RELAYS, "74HC595")]
    )
    def test_the_switch_is_told_by_the_name_of_its_chip(
        self, tmp_path: Path, text: str, chip: str
    ) -> None:
        assert load_board(write(tmp_path, "board.toml", text)).switch.chip == chip


class TestLines:
    @pytest.mark.parametrize(
        ("old", "new", "line", "text", "other"),
        [
            ("CLK = 24", "CLK = 23", 23, "BL", "CLK"),
            ("POL = 4", "POL = 5", 5, "POL", "DATA"),
            ("hv_enable = { line = 25", "hv_enable = { line = 22", 22, "LE", "HV"),
            ("heartbeat = { line = 27", "heartbeat = { line = 25", 25, "HV", "HEARTBEAT"),
            ("readback = 18", "readback = 27", 27, "HEARTBEAT", "READBACK"),
            ("emergency_stop = 17", "emergency_stop = 18", 18, "READBACK", "EMERGENCY_STOP"),
            ("wearer_stop = 16", "wearer_stop = 17", 17, "EMERGENCY_STOP", "WEARER_STOP"),
            ("sync_line = 12", "sync_line = 16", 16, "WEARER_STOP", "SYNC"),
            ("sync_line = 12", "sync_line = 11", 11, "/dev/spidev0.0", "SYNC"),
            ("trigger = { line = 13", "trigger = { line = 12", 12, "SYNC", "TRIGGER"),
            ("trigger = { line = 13", "trigger = { line = 9", 9, "/dev/spidev0.0", "TRIGGER"),
            (
                "sync_line = 12",
                'sync_line = 12\ntoo_strong = { line = 12, edge = "falling" }',
                12,
                "SYNC",
                "TOO_STRONG",
            ),
            ("POL = 4", "POL = 2", 2, "/dev/i2c-1", "POL"),
            ("DATA = 5", "DATA = 8", 8, "/dev/spidev0.0", "DATA"),
        ],
    )
    def test_a_line_for_two_functions_is_refused_with_both(
        self, tmp_path: Path, old: str, new: str, line: int, text: str, other: str
    ) -> None:
        said = f"it is used for {text} and for {other}"
        refused(load_board, tmp_path, spoiled(REFERENCE, old, new), f"line {line}", said)

    def test_without_i2c_its_lines_are_free(self, tmp_path: Path) -> None:
        board = load_board(write(tmp_path, "board.toml", spoiled(KIT, "POL = 4", "POL = 2")))
        assert board.used_lines()["POL"] == 2

    @pytest.mark.parametrize("text", [KIT, RELAYS])
    def test_data_above_the_clock_is_refused_with_what_would_happen(
        self, tmp_path: Path, text: str
    ) -> None:
        error = refused(
            load_board, tmp_path, spoiled(text, "DATA = 5", "DATA = 26"), "switch.lines.DATA",
            "line 26 is above CLK (line 24)", "the clock would rise before its data",
        )  # fmt: skip
        assert error.allowed.endswith("put DATA below CLK")

    @pytest.mark.parametrize(("name", "line"), [("LE", 22), ("POL", 4)])
    def test_a_line_that_settles_after_un_blanking_is_refused(
        self, tmp_path: Path, name: str, line: int
    ) -> None:
        text = spoiled(KIT, f"{name} = {line}", f"{name} = 26")
        refused(
            load_board, tmp_path, text, f"switch.lines.{name}", "line 26 is above BL (line 23)",
            f"un-blanked before {name} is settled", f"put {name} below BL",
        )  # fmt: skip

    def test_relays_have_no_such_order(self, tmp_path: Path) -> None:
        text = spoiled(RELAYS, "LE = 22", "LE = 26")
        assert load_board(write(tmp_path, "board.toml", text)).switch.lines.LE == 26

    @pytest.mark.parametrize("line", [0, 1, 28, -4])
    def test_a_line_that_the_header_has_not_is_refused(self, tmp_path: Path, line: int) -> None:
        text = spoiled(KIT, "POL = 4", f"POL = {line}")
        refused(load_board, tmp_path, text, "switch.lines.POL", f"it says {line}", "a whole number")

    def test_a_missing_line_is_refused_by_name(self, tmp_path: Path) -> None:
        text = spoiled(KIT, "BL = 23, ", "")
        refused(load_board, tmp_path, text, "switch.lines", "missing required field `BL`")

    @given(st.permutations(range(14, 28)))
    def test_whatever_the_order_what_loads_has_safe_steps(
        self, tmp_path_factory: pytest.TempPathFactory, lines: list[int]
    ) -> None:
        names = dict(zip(("POL", "DATA", "LE", "BL", "CLK"), lines, strict=False))
        is_safe = names["DATA"] < names["CLK"] and max(names["LE"], names["POL"]) < names["BL"]
        text = KIT
        for name, old in (("POL", 4), ("DATA", 5), ("LE", 22), ("BL", 23), ("CLK", 24)):
            text = spoiled(text, f"{name} = {old}", f"{name} = {names[name]}")
        path = write(tmp_path_factory.getbasetemp(), "any-order.toml", text)
        if is_safe:
            assert load_board(path).used_lines() == {**names, "SYNC": 12, "TRIGGER": 13}
        else:
            with pytest.raises(FileError, match="ascending order"):
                load_board(path)


class TestSwitch:
    @pytest.mark.parametrize(
        ("text", "old", "new", "a_chip"),
        [(KIT, 64, 61, 64), (KIT, 64, 32, 64), (HV513, 32, 30, 8), (RELAYS, 32, 30, 4)],
    )
    def test_a_chain_that_ends_within_a_chip_is_refused(
        self, tmp_path: Path, text: str, old: int, new: int, a_chip: int
    ) -> None:
        spoilt = spoiled(text, f"outputs = {old}", f"outputs = {new}")
        said = f"{new} is not a whole number of chips with {a_chip} each"
        refused(load_board, tmp_path, spoilt, "switch.outputs", said, "old bits would stay")

    @pytest.mark.parametrize("outputs", [0, 257])
    def test_a_chain_too_short_or_too_long_is_refused(self, tmp_path: Path, outputs: int) -> None:
        text = spoiled(KIT, "outputs = 64", f"outputs = {outputs}")
        refused(load_board, tmp_path, text, "switch.outputs", f"it says {outputs}")

    def test_a_chip_that_nobody_can_drive_is_refused(self, tmp_path: Path) -> None:
        text = spoiled(KIT, 'chip = "HV507"', 'chip = "HV508"')
        refused(load_board, tmp_path, text, "switch.chip", "it says 'HV508'")

    def test_one_bit_for_both_relays_is_refused(self, tmp_path: Path) -> None:
        text = spoiled(RELAYS, "return_bit = 1", "return_bit = 0")
        refused(
            load_board, tmp_path, text, "switch.return_bit", "the same bit as on_bit",
            "one relay goes to the source",
        )  # fmt: skip

    @pytest.mark.parametrize("key", ["ton_us", "toff_us"])
    def test_relay_times_are_needed(self, tmp_path: Path, key: str) -> None:
        text = spoiled(RELAYS, f"{key} = 1_000\n", "")
        refused(load_board, tmp_path, text, "switch", f"missing required field `{key}`")

    def test_half_bridges_have_no_relay_times(self, tmp_path: Path) -> None:
        text = spoiled(KIT, "outputs = 64", "outputs = 64\nton_us = 1_000")
        refused(load_board, tmp_path, text, "switch", "unknown field `ton_us`")


class TestForm:
    def test_a_file_that_is_not_there_is_named(self, tmp_path: Path) -> None:
        path = tmp_path / "nowhere.toml"
        with pytest.raises(FileError, match="there is no such file") as caught:
            load_board(path)
        assert caught.value.file == str(path)

    def test_a_folder_is_no_file(self, tmp_path: Path) -> None:
        with pytest.raises(FileError, match="it cannot be read"):
            load_board(tmp_path)

    def test_bytes_that_are_no_text_are_told(self, tmp_path: Path) -> None:
        path = tmp_path / "board.toml"
        path.write_bytes(b"name = '\xff'")
        with pytest.raises(FileError, match="it cannot be read"):
            load_board(path)

    def test_what_is_no_toml_is_told_with_its_line(self, tmp_path: Path) -> None:
        text = spoiled(KIT, "rest_us = 200", "rest_us 200")
        refused(load_board, tmp_path, text, "", "it is not TOML", "at line 6")

    @pytest.mark.parametrize("name", ["", "Kit", "-kit", "a b", "x" * 41, "../etc"])
    def test_a_name_is_one_plain_word(self, tmp_path: Path, name: str) -> None:
        text = spoiled(KIT, 'name = "kajimoto-hv507"', f'name = "{name}"')
        refused(load_board, tmp_path, text, "name", "text in quotes that fits ^[a-z0-9]")

    def test_a_whole_table_in_the_wrong_place_is_not_repeated_in_the_sentence(
        self, tmp_path: Path
    ) -> None:
        table = "{ other = 'a table that is longer than sixty characters, all in all' }"
        text = spoiled(KIT, "rest_us = 200", f"rest_us = {table}")
        refused(load_board, tmp_path, text, "rest_us", "the table there")
