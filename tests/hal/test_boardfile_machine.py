"""Machine files: ranges, and bounds that would switch themselves off."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from etd_hal.boardfile import load_machine
from files_by_hand import write
from spoiled_boards import PI4, refused


class TestMachine:
    @pytest.mark.parametrize("key", ["word_us", "delay_extra_us", "message_us"])
    def test_a_range_whose_ends_are_swapped_is_refused(self, tmp_path: Path, key: str) -> None:
        text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {{ low = 3.0, high = 2.0 }}", PI4)
        refused(load_machine, tmp_path, text, key, "low 3.0 is above high 2.0", "swap them")

    @pytest.mark.parametrize(
        ("key", "bound"), [("guard_word_us", 24.0), ("guard_delay_extra_us", 1.2)]
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
        refused(load_machine, tmp_path, text, key, "a number")

    @pytest.mark.parametrize(
        ("key", "ceiling"), [("halt_excess_us", 1_000), ("drift_us", 50), ("spread_us", 200)]
    )
    def test_no_machine_lets_messages_be_further_from_their_plan_than_the_ceilings(
        self, tmp_path: Path, key: str, ceiling: int
    ) -> None:
        above, on_it = (
            re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", PI4)
            for value in (ceiling + 1, ceiling)
        )
        refused(load_machine, tmp_path, above, key, f"at most {ceiling}")
        assert getattr(load_machine(write(tmp_path, "machine.toml", on_it)), key) == ceiling

    @pytest.mark.parametrize("value", ["nan", "inf", "-0.1"])
    @pytest.mark.parametrize("end", ["low", "high"])
    def test_the_ends_of_a_range_are_numbers(self, tmp_path: Path, end: str, value: str) -> None:
        ends = {"low": "1.0", "high": "2.0"} | {end: value}
        text = re.sub(
            r"(?m)^word_us = .*$",
            f"word_us = {{ low = {ends['low']}, high = {ends['high']} }}",
            PI4,
        )
        refused(load_machine, tmp_path, text, f"word_us.{end}", "a number")

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
