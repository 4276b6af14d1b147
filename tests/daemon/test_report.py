"""`etd report`: its figures against those that were worked out by hand."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from etd.cli import main
from etd.files.configuration import LoadedConfig, fake_config
from etd.report.figures import Figures, figures_of
from etd.report.text import html, lines, methods, sections
from etd.report.worst_cases import ROWS, charge_uc

HARDWARE = (Path(__file__).parents[2] / "docs" / "hardware.md").read_text("utf-8")


def changed(compliance_v: int, diameter_mm: float) -> LoadedConfig:
    loaded = fake_config()
    source = msgspec.structs.replace(loaded.board.source, compliance_v=compliance_v)
    board = msgspec.structs.replace(loaded.board, source=source)
    array = msgspec.structs.replace(loaded.array, diameter_mm=diameter_mm)
    return dataclasses.replace(loaded, board=board, array=array)


def reported(loaded: LoadedConfig) -> Figures:
    return figures_of(loaded, "passed on a day")


def test_the_shipped_fingertip_by_hand() -> None:
    """1 mm: pi x (0.05 cm)^2 = 0.007854 cm2. 500 nC: 63.66 uC/cm2. 8 mA: 1018.6 mA/cm2; 500 nC of
    it last 62.5 us. At 2 kohm 16 V, 8 uJ; 30 uA of mean current: 0.48 mW, 61.12 mW/cm2.
    """
    found = reported(fake_config(board="kajimoto-hv507"))
    assert found.area_cm2 == pytest.approx(0.007854, rel=1e-4)
    assert found.charge_density_uc_cm2 == pytest.approx(63.66, rel=1e-4)
    assert found.current_density_ma_cm2 == pytest.approx(1018.6, rel=1e-4)
    assert found.mean_current_density_ma_cm2 == pytest.approx(3.8197, rel=1e-4)
    assert found.pitch_mm == 2.5
    at = found.at_loads[1]
    assert (at.resistance_ohm, at.current_ua, at.width_us) == (2_000, 8_000, 62.5)
    assert (at.voltage_v, at.energy_uj, at.power_mw) == pytest.approx((16.0, 8.0, 0.48))
    assert at.power_density_mw_cm2 == pytest.approx(61.115, rel=1e-4)


def test_a_weak_supply_on_large_electrodes_by_hand() -> None:
    """5 mm: 0.19635 cm2. 60 V into 10 kohm are 6 mA; 500 nC of it last 83.33 us; 30 uJ; 30 uA of
    mean current: 1.8 mW, 9.167 mW/cm2. Into 500 ohm it is the maximum, 8 mA, and 4 V.
    """
    found = reported(changed(60, 5.0))
    assert found.area_cm2 == pytest.approx(0.19635, rel=1e-4)
    small, _, large = found.at_loads
    assert (small.current_ua, small.voltage_v) == (8_000, 4.0)
    assert (large.current_ua, large.voltage_v) == (6_000, 60.0)
    assert large.width_us == pytest.approx(83.33, rel=1e-4)
    assert (large.energy_uj, large.power_mw) == pytest.approx((30.0, 1.8))
    assert large.power_density_mw_cm2 == pytest.approx(9.167, rel=1e-4)


def test_what_guards_let_through_is_what_the_document_says() -> None:
    """At 10 mA, which the document is for."""
    table = [line for line in HARDWARE.splitlines() if line.startswith("| ")]
    units = {"uC": 1.0, "mC": 1_000.0}
    for row in ROWS:
        key = re.sub(r"[^a-z ]", "", row.what.split(",")[0].split(":")[-1].lower()).strip()
        words = set(key.split())
        best = max(table, key=lambda line: len(words & set(re.findall(r"[a-z]+", line.lower()))))
        amount, unit = re.findall(r"([\d.]+) (uC|mC)", best.rsplit("|", 2)[1])[0]
        assert charge_uc(row, 10_000) == pytest.approx(float(amount) * units[unit]), (row, best)


def test_a_guard_that_is_not_there_is_said_to_be_absent() -> None:
    text = "\n".join(lines(reported(fake_config(board="kajimoto-hv507"))))
    assert "(NOT on this board)  250 us: 2.5 uC" in text
    assert re.search(r"one_shot +ABSENT", text)
    text = "\n".join(lines(reported(fake_config(board="reference-hv507"))))
    assert re.search(r"\(this board has it\) +250 us: 2.5 uC", text)
    assert re.search(r"one_shot +present", text)


def test_all_forms_have_all_that_is_asked_for() -> None:
    found = reported(fake_config())
    page, paragraph = html(found), methods(found)
    for _, rows in sections(found):
        for what, how_much in rows:
            assert what.replace("'", "&#x27;") in page
            assert how_much.replace("'", "&#x27;") in page
    for part in (
        "64 electrodes of 1 mm",
        "63.7 uC/cm2",
        "300 V",
        "absent: emergency_stop",
        "[Part",
    ):
        assert part in paragraph


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    status = main(["report", "--board", "fake", *words])
    return status, capsys.readouterr().out


def test_the_command_prints_each_form(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    status, text = run(capsys)
    assert (status, text.splitlines()[0]) == (0, "Device")
    assert "none is stored for this board" in text
    status, text = run(capsys, "--json")
    answer: dict[str, Any] = json.loads(text)
    assert (status, answer["ok"], answer["charge_nc"]) == (0, True, 500.0)
    assert run(capsys, "--methods")[1].startswith("Electrical stimuli were delivered")
    file = tmp_path / "report.html"
    assert run(capsys, "--html", str(file))[0] == 0
    assert file.read_text("utf-8").startswith("<!doctype html>")
    assert main(["report", "--board", "fake", "--html", str(file)]) == 1, "it is there already"
