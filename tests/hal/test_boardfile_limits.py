"""Board files: limits, constants and guards that are missing, misspelt or out of bounds."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from etd_hal.boardfile import GUARDS, BoardMaxima, load_board
from files_by_hand import spoiled, write
from spoiled_boards import KIT, REFERENCE, refused

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
            f"it says {beyond}", f"{'to' if end else 'from'} {bound}",
        )  # fmt: skip

    @pytest.mark.parametrize("key", BOUNDS)
    def test_a_limit_on_its_upper_bound_is_allowed(self, tmp_path: Path, key: str) -> None:
        bound = BOUNDS[key][1]
        path = write(tmp_path, "board.toml", self.with_limit(key, str(bound)))
        assert getattr(load_board(path).maxima, key) == bound

    @pytest.mark.parametrize("value", ["true", "'300'", "300.5", "[300]", "nan"])
    def test_a_limit_that_is_no_whole_number_is_refused(self, tmp_path: Path, value: str) -> None:
        text = self.with_limit("current_ua", value)
        refused(load_board, tmp_path, text, "maxima.current_ua", "a whole number")

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
            ("mode = 1 ", "mode = 0 ", "mode"),
            ('spi = "/dev/spidev0.0"', "spi = '/dev/../etc/passwd'", "spi"),
            ('spi = "/dev/spidev0.0"', "spi = '/dev/spidev0.0/../mem'", "spi"),
            ('spi = "/dev/spidev0.0"', "spi = 'spidev0.0'", "spi"),
            ("speed_hz = 20_800_000", "speed_hz = 3_900_000", "speed_hz"),
            ("speed_hz = 20_800_000", "speed_hz = 48_000_001", "speed_hz"),
            ("full_scale_ua = 10_000", "full_scale_ua = 50_001", "full_scale_ua"),
            ('dac = "AD5452"', "dac = 'AD5453'", "dac"),
            ('adc = "AD7276"', "adc = 'AD7277'", "adc"),
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


class TestGuards:
    @pytest.mark.parametrize("name", GUARDS)
    def test_each_guard_is_declared_and_nothing_is_assumed(self, tmp_path: Path, name: str) -> None:
        text = re.sub(rf'(?m)^{name} = "absent".*$', "", KIT)
        refused(load_board, tmp_path, text, "guards", f"missing required field `{name}`")

    def test_a_guard_with_a_typo_is_refused(self, tmp_path: Path) -> None:
        text = spoiled(KIT, 'readback = "absent"', 'readback = "absnet"')
        refused(load_board, tmp_path, text, "guards.readback", "it says 'absnet'")

    @pytest.mark.parametrize("has_setpoint", [True, False])
    def test_chips_on_i2c_need_its_bus(self, tmp_path: Path, has_setpoint: bool) -> None:
        text = spoiled(REFERENCE, 'i2c = "/dev/i2c-1"\n', "")
        if not has_setpoint:
            text = text.partition("[rail_setpoint]")[0]
        refused(load_board, tmp_path, text, "i2c", "name the bus device")

    def test_a_set_point_that_nothing_looks_at_is_refused(self, tmp_path: Path) -> None:
        text = re.sub(r"(?m)^rail_monitor = .*$", 'rail_monitor = "absent"', REFERENCE)
        refused(load_board, tmp_path, text, "rail_setpoint", "there is no guards.rail_monitor")

    @pytest.mark.parametrize("device", ["/dev/../etc/passwd", "/dev/i2c-1/", "i2c-1", "absnet"])
    def test_an_i2c_bus_is_one_of_i2c_dev(self, tmp_path: Path, device: str) -> None:
        text = spoiled(REFERENCE, 'i2c = "/dev/i2c-1"', f"i2c = '{device}'")
        refused(load_board, tmp_path, text, "i2c", f"it says '{device}'")

    def test_a_board_without_chips_on_i2c_needs_none(self, tmp_path: Path) -> None:
        assert load_board(write(tmp_path, "board.toml", KIT)).i2c == "absent"

    @pytest.mark.parametrize(("key", "volts"), [("off_v", 280.0), ("high_v", 280.0)])
    def test_the_voltages_of_the_rail_rise(self, tmp_path: Path, key: str, volts: float) -> None:
        text = re.sub(r"low_v = [\d.]+", "low_v = 280.0", REFERENCE)
        text = re.sub(rf"{key} = [\d.]+", f"{key} = {volts}", text)
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
            text = text.partition("[rail_setpoint]")[0]
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
