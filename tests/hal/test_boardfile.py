"""Board and machine files: every rule, told with file, key, value and what is allowed instead."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from board_rig import MACHINES
from etd_hal.boardfile import GUARDS, BoardMaxima, load_board, load_machine
from etd_hal.errors import FileError
from files_by_hand import spoiled, write
from stepped_board import BOARDS

REFERENCE = (BOARDS / "reference-hv507.toml").read_text("utf-8")
KIT = (BOARDS / "kajimoto-hv507.toml").read_text("utf-8")
RELAYS = (BOARDS / "feetthrough-relay.toml").read_text("utf-8")
HV513 = (BOARDS / "etactilekit-hv513.toml").read_text("utf-8")
PI4 = (MACHINES / "pi4.toml").read_text("utf-8")

#: Hard ceilings and floors of the format.
BOUNDS = {
    "current_ua": (50, 10_000),
    "width_us": (20, 200),
    "charge_nc": (1, 2_000),
    "rate_hz": (1, 200),
    "mean_current_ua": (1, 120),
    "array_mean_current_ua": (1, 8_000),
    "probe_current_ua": (10, 1_000),
    "probe_width_us": (16, 50),
}


def refused(
    load: Callable[[Path], object], folder: Path, text: str, key: str, *fragments: str
) -> FileError:
    """Refused at this key; the sentence has the file and all fragments."""
    path = write(folder, "spoiled.toml", text)
    with pytest.raises(FileError) as caught:
        load(path)
    assert caught.value.file == str(path)
    assert caught.value.key == key
    for fragment in (str(path), key, *fragments):
        assert fragment in str(caught.value)
    return caught.value


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

    def test_lines_are_told_by_function(self) -> None:
        assert load_board(BOARDS / "reference-hv507.toml").used_lines() == {
            "POL": 4, "DATA": 5, "LE": 22, "BL": 23, "CLK": 24, "HV": 25, "HEARTBEAT": 27,
            "READBACK": 18, "EMERGENCY_STOP": 17, "WEARER_STOP": 16, "SYNC": 12,
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
        ("old", "new", "line", "one", "other"),
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
            ("POL = 4", "POL = 2", 2, "/dev/i2c-1", "POL"),
            ("DATA = 5", "DATA = 8", 8, "/dev/spidev0.0", "DATA"),
        ],
    )
    def test_a_line_for_two_functions_is_refused_with_both(
        self, tmp_path: Path, old: str, new: str, line: int, one: str, other: str
    ) -> None:
        said = f"it is used for {one} and for {other}"
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
        refused(load_board, tmp_path, text, "switch.lines.POL", f"it says {line}", "`int`")

    def test_a_missing_line_is_refused_by_name(self, tmp_path: Path) -> None:
        text = spoiled(KIT, "BL = 23, ", "")
        refused(load_board, tmp_path, text, "switch.lines", "missing required field `BL`")

    @given(st.permutations(range(12, 26)))
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
            assert load_board(path).used_lines() == names
        else:
            with pytest.raises(FileError, match="ascending order"):
                load_board(path)


class TestMaxima:
    def with_limit(self, key: str, value: str) -> str:
        return re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}" if value else "", KIT)

    def test_the_table_has_every_limit(self) -> None:
        assert set(BoardMaxima.__struct_fields__) == set(BOUNDS)

    @pytest.mark.parametrize("key", BOUNDS)
    def test_a_missing_limit_is_a_refusal_and_never_a_default(
        self, tmp_path: Path, key: str
    ) -> None:
        said = f"missing required field `{key}`"
        refused(load_board, tmp_path, self.with_limit(key, ""), "maxima", said)

    @pytest.mark.parametrize("key", BOUNDS)
    @pytest.mark.parametrize("end", [0, 1])
    def test_a_limit_beyond_its_bound_is_refused_with_value_and_bound(
        self, tmp_path: Path, key: str, end: int
    ) -> None:
        bound = BOUNDS[key][end]
        beyond = bound + (1 if end else -1)
        refused(
            load_board, tmp_path, self.with_limit(key, str(beyond)), f"maxima.{key}",
            f"it says {beyond}", f"{'<=' if end else '>='} {bound}",
        )  # fmt: skip

    @pytest.mark.parametrize("key", BOUNDS)
    def test_a_limit_on_its_upper_bound_is_allowed(self, tmp_path: Path, key: str) -> None:
        bound = BOUNDS[key][1]
        path = write(tmp_path, "board.toml", self.with_limit(key, str(bound)))
        assert getattr(load_board(path).maxima, key) == bound

    @pytest.mark.parametrize("value", ["true", "'300'", "300.5", "[300]", "nan"])
    def test_a_limit_that_is_no_whole_number_is_refused(self, tmp_path: Path, value: str) -> None:
        text = self.with_limit("current_ua", value)
        refused(load_board, tmp_path, text, "maxima.current_ua", "`int`")

    def test_a_limit_with_a_typo_is_an_unknown_key(self, tmp_path: Path) -> None:
        text = spoiled(KIT, "rate_hz = 200", "rate_hz = 200\nrate_Hz = 100")
        refused(load_board, tmp_path, text, "maxima", "unknown field `rate_Hz`")

    def test_more_than_the_source_makes_is_refused(self, tmp_path: Path) -> None:
        text = spoiled(KIT, "full_scale_ua = 10_000", "full_scale_ua = 9_999")
        refused(
            load_board, tmp_path, text, "maxima.current_ua",
            "10000 uA is more than the source makes (9999 uA)", "at most the full scale",
        )  # fmt: skip

    def test_a_probe_stronger_than_a_stimulus_is_refused(self, tmp_path: Path) -> None:
        text = re.sub(r"(?m)^current_ua = .*$", "current_ua = 299", KIT)
        refused(
            load_board, tmp_path, text, "maxima.probe_current_ua", "300 uA is above current_ua",
            "a probe is weaker",
        )  # fmt: skip

    def test_a_probe_as_strong_as_a_stimulus_is_not(self, tmp_path: Path) -> None:
        text = re.sub(r"(?m)^current_ua = .*$", "current_ua = 300", KIT)
        assert load_board(write(tmp_path, "board.toml", text)).maxima.current_ua == 300


class TestSource:
    @pytest.mark.parametrize(
        ("old", "new", "key"),
        [
            ("mode = 1 ", "mode = 3 ", "mode"),
            ("speed_hz = 10_400_000", "speed_hz = 3_900_000", "speed_hz"),
            ("speed_hz = 10_400_000", "speed_hz = 48_000_001", "speed_hz"),
            ("full_scale_ua = 10_000", "full_scale_ua = 50_001", "full_scale_ua"),
            ("codes = 4096", "codes = 1024", "codes"),
            ("leak_ohm = 66_000", "leak_ohm = 9_999", "leak_ohm"),
            ("node_uv_per_code = 89_300", "node_uv_per_code = 0", "node_uv_per_code"),
            ("compliance_v = 300", "compliance_v = 501", "compliance_v"),
        ],
    )
    def test_a_constant_that_cannot_be_is_refused(
        self, tmp_path: Path, old: str, new: str, key: str
    ) -> None:
        value = new.partition("= ")[2].replace("_", "").strip()
        text = spoiled(KIT, old, new)
        refused(load_board, tmp_path, text, f"source.{key}", f"it says {value}")

    @pytest.mark.parametrize("rest_us", [19, 10_001])
    def test_a_rest_that_cannot_be_is_refused(self, tmp_path: Path, rest_us: int) -> None:
        text = spoiled(KIT, "rest_us = 200", f"rest_us = {rest_us}")
        refused(load_board, tmp_path, text, "rest_us", f"it says {rest_us}")


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


class TestGuards:
    @pytest.mark.parametrize("name", GUARDS)
    def test_each_guard_is_declared_and_nothing_is_assumed(self, tmp_path: Path, name: str) -> None:
        text = re.sub(rf'(?m)^{name} = "absent".*$', "", KIT)
        refused(load_board, tmp_path, text, "guards", f"missing required field `{name}`")

    def test_a_guard_with_a_typo_is_refused(self, tmp_path: Path) -> None:
        text = spoiled(KIT, 'readback = "absent"', 'readback = "absnet"')
        refused(load_board, tmp_path, text, "guards.readback", "it says 'absnet'")

    @pytest.mark.parametrize("keeps", ["rail_monitor", "rail_setpoint"])
    def test_chips_on_i2c_need_its_bus(self, tmp_path: Path, keeps: str) -> None:
        text = spoiled(REFERENCE, 'i2c = "/dev/i2c-1"\n', "")
        if keeps == "rail_monitor":
            text = text.partition("[rail_setpoint]")[0]
        else:
            text = re.sub(r"(?m)^rail_monitor = .*$", 'rail_monitor = "absent"', text)
        refused(load_board, tmp_path, text, "i2c", "name the bus device")

    def test_a_board_without_chips_on_i2c_needs_none(self, tmp_path: Path) -> None:
        assert load_board(write(tmp_path, "board.toml", KIT)).i2c == "absent"

    @pytest.mark.parametrize(("key", "volts"), [("off_v", 300.0), ("low_v", 400.0)])
    def test_the_voltages_of_the_rail_rise(self, tmp_path: Path, key: str, volts: float) -> None:
        text = re.sub(rf"{key} = [\d.]+", f"{key} = {volts}", REFERENCE)
        refused(load_board, tmp_path, text, "guards.rail_monitor", "do not rise")

    def test_a_rail_beyond_the_monitors_scale_is_refused(self, tmp_path: Path) -> None:
        text = re.sub(r"divider = [\d.]+", "divider = 90.0", REFERENCE)
        refused(load_board, tmp_path, text, "guards.rail_monitor.high_v", "a larger divider")

    @pytest.mark.parametrize("has_monitor", [True, False])
    def test_a_heartbeat_needs_the_line_that_it_gates(
        self, tmp_path: Path, has_monitor: bool
    ) -> None:
        text = re.sub(r"(?m)^hv_enable = .*$", 'hv_enable = "absent"', REFERENCE)
        if not has_monitor:
            text = re.sub(r"(?m)^rail_monitor = .*$", 'rail_monitor = "absent"', text)
        refused(load_board, tmp_path, text, "guards.heartbeat", "there is no hv_enable")

    def test_a_monitor_without_an_enable_line_is_allowed(self, tmp_path: Path) -> None:
        text = re.sub(r"(?m)^hv_enable = .*$", 'hv_enable = "absent"', REFERENCE)
        text = re.sub(r"(?m)^heartbeat = .*$", 'heartbeat = "absent"', text)
        assert load_board(write(tmp_path, "board.toml", text)).absent_guards == (
            "hv_enable", "heartbeat",
        )  # fmt: skip

    @pytest.mark.parametrize(
        ("old", "new", "key"),
        [
            ("address = 0x48", "address = 0x78", "guards.rail_monitor.address"),
            ("channel = 0", "channel = 4", "guards.rail_monitor.channel"),
            ("divider = 100.0", "divider = nan", "guards.rail_monitor.divider"),
            ("window_ms = 20", "window_ms = 101", "guards.heartbeat.window_ms"),
            ("on_us = 250", "on_us = 199", "guards.one_shot.on_us"),
            ("code = 3_500", "code = 4_096", "rail_setpoint.code"),
            ("on = 1", "on = 2", "guards.hv_enable.on"),
        ],
    )
    def test_a_guards_wiring_is_bounded(self, tmp_path: Path, old: str, new: str, key: str) -> None:
        text = re.sub(r"divider = [\d.]+", "divider = 100.0", REFERENCE)
        refused(load_board, tmp_path, spoiled(text, old, new), key, "it says")


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
        refused(load_board, tmp_path, text, "name", "matching regex")

    def test_a_whole_table_in_the_wrong_place_is_not_repeated_in_the_sentence(
        self, tmp_path: Path
    ) -> None:
        table = "{ other = 'a table that is longer than sixty characters, all in all' }"
        text = spoiled(KIT, "rest_us = 200", f"rest_us = {table}")
        refused(load_board, tmp_path, text, "rest_us", "the table there")


class TestMachine:
    @pytest.mark.parametrize("key", ["word_us", "delay_extra_us", "message_us"])
    def test_a_range_whose_ends_are_swapped_is_refused(self, tmp_path: Path, key: str) -> None:
        text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {{ low = 3.0, high = 2.0 }}", PI4)
        refused(load_machine, tmp_path, text, key, "low 3.0 is above high 2.0", "swap them")

    @pytest.mark.parametrize(
        ("key", "bound"), [("guard_word_us", 22.0), ("guard_delay_extra_us", 1.2)]
    )
    def test_a_worst_case_below_what_calibration_accepts_is_refused(
        self, tmp_path: Path, key: str, bound: float
    ) -> None:
        below = re.sub(rf"(?m)^{key} = .*$", f"{key} = {bound - 0.1:.1f}", PI4)
        refused(load_machine, tmp_path, below, key, "below the high end", f"({bound})")
        on_it = re.sub(rf"(?m)^{key} = .*$", f"{key} = {bound}", PI4)
        assert getattr(load_machine(write(tmp_path, "machine.toml", on_it)), key) == bound

    @pytest.mark.parametrize(
        "key",
        ["spread_us", "halt_excess_us", "drift_us", "gpio_call_us", "guard_word_us", "visit_us"],
    )
    @pytest.mark.parametrize("value", ["nan", "inf", "-1.0", "'3'"])
    def test_a_bound_that_would_switch_itself_off_is_refused(
        self, tmp_path: Path, key: str, value: str
    ) -> None:
        text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", PI4)
        refused(load_machine, tmp_path, text, key, "`float`")

    @pytest.mark.parametrize("value", ["nan", "inf", "-0.1"])
    @pytest.mark.parametrize("end", ["low", "high"])
    def test_the_ends_of_a_range_are_numbers(self, tmp_path: Path, end: str, value: str) -> None:
        ends = {"low": "1.0", "high": "2.0"} | {end: value}
        text = re.sub(
            r"(?m)^word_us = .*$",
            f"word_us = {{ low = {ends['low']}, high = {ends['high']} }}",
            PI4,
        )
        refused(load_machine, tmp_path, text, f"word_us.{end}", "`float`")

    @given(low=st.floats(0, 100), high=st.floats(0, 100))
    def test_any_range_in_order_is_allowed(
        self, tmp_path_factory: pytest.TempPathFactory, low: float, high: float
    ) -> None:
        assume(low <= high)
        text = re.sub(
            r"(?m)^message_us = .*$", f"message_us = {{ low = {low!r}, high = {high!r} }}", PI4
        )
        path = write(tmp_path_factory.getbasetemp(), "any-range.toml", text)
        assert load_machine(path).message_us.high == high
