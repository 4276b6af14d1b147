"""The count of a pulse's instructions: what each run takes besides its pulses is left out of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bench.both import CLONE, KINDS, code_of
from bench.instructions import of_a_pulse
from bench.modelled import ELECTRODES

A_PULSE = 355_800
START = 830_705_687


def scans_of(program: str) -> int:
    (scans,) = re.findall(r"measure\((\d+)[,)]", program)
    return int(scans)


@pytest.mark.parametrize("kind", KINDS.values())
def test_start_and_imports_are_no_part_of_a_pulse(kind: str) -> None:
    def count(program: str, path: list[Path]) -> int:
        assert kind in program
        return START + scans_of(program) * ELECTRODES * A_PULSE

    assert of_a_pulse(count, kind, []) == A_PULSE


def test_another_checkout_is_counted_with_its_own_benchmark_and_comes_first(tmp_path: Path) -> None:
    compiled = tmp_path / "compiled"
    assert list(code_of(None, compiled)) == ["interpreted"]
    compiled.mkdir()
    code = code_of(tmp_path / "older", compiled)
    assert list(code) == ["older", "interpreted", "compiled"]
    assert code["older"][-1] == tmp_path / "older" / "tests"
    assert code["compiled"] == [compiled, CLONE / "tests"]
