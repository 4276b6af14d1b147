"""Which machine this is, from the files that a kernel shows."""

from __future__ import annotations

from pathlib import Path

import pytest

from etd_hal.bench import CpuClock
from etd_hal.boardfile import Bounds, MachineFile
from etd_hal.linux import machine

TREE = "sys/firmware/devicetree/base"


def machine_file(*models: str) -> MachineFile:
    some = Bounds(low=0.0, high=1.0)
    return MachineFile(
        name="pi4",
        title="for a test",
        models=models,
        word_us=some,
        delay_extra_us=some,
        message_us=some,
        spread_us=1.0,
        halt_excess_us=1.0,
        drift_us=1.0,
        gpio_call_us=1.0,
        visit_us=1.0,
        guard_word_us=1.0,
        guard_delay_extra_us=1.0,
    )


def lay_out(root: Path, **files: str) -> Path:
    """Write kernel files below `root`; "__" in a key stands for a slash."""
    for key, text in files.items():
        path = root / key.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def pi(root: Path, model: str, chip: str) -> Path:
    for name, text in (("model", f"{model}\0"), ("compatible", f"raspberrypi,x\0brcm,{chip}\0")):
        path = root / TREE / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def test_the_machine_that_the_file_names_is_taken(tmp_path: Path) -> None:
    here = pi(tmp_path, "Raspberry Pi 4 Model B Rev 1.4", "bcm2711")
    assert machine.problem(machine_file("Raspberry Pi 4"), here) is None


@pytest.mark.parametrize(
    "model", ["Raspberry Pi 5 Model B Rev 1.0", "Raspberry Pi Compute Module 5", "Raspberry Pi 500"]
)
@pytest.mark.parametrize("models", [("Raspberry Pi 5",), ("Raspberry Pi Compute",), ()])
def test_a_pi_5_is_refused_whatever_the_file_says(
    tmp_path: Path, model: str, models: tuple[str, ...]
) -> None:
    found = machine.problem(machine_file(*models), pi(tmp_path, model, "bcm2712"))
    assert found is not None
    assert model in found
    assert "interrupts" in found


def test_another_machine_is_refused_with_its_name_and_those_expected(tmp_path: Path) -> None:
    here = pi(tmp_path, "Raspberry Pi 3 Model B", "bcm2837")
    found = machine.problem(machine_file("Raspberry Pi 4", "Raspberry Pi 400"), here)
    assert found is not None
    assert "Raspberry Pi 3 Model B" in found
    assert "Raspberry Pi 4, Raspberry Pi 400" in found


def test_a_pc_is_called_what_its_firmware_calls_it(tmp_path: Path) -> None:
    here = lay_out(
        tmp_path,
        sys__class__dmi__id__sys_vendor="QEMU\n",
        sys__class__dmi__id__product_name="Standard PC (Q35 + ICH9, 2009)\n",
    )
    assert machine.model(here) == "QEMU Standard PC (Q35 + ICH9, 2009)"
    assert machine.problem(machine_file("QEMU"), here) is None


def test_a_machine_of_no_known_model_fits_only_a_file_without_models(tmp_path: Path) -> None:
    assert machine.problem(machine_file(), tmp_path) is None
    found = machine.problem(machine_file("Raspberry Pi 4"), tmp_path)
    assert found is not None
    assert "of unknown model" in found


@pytest.mark.parametrize(
    ("value", "says"), [("Y\n", "keep their last level"), ("N\n", "the pulls decide")]
)
def test_what_the_pins_do_after_us_is_told(tmp_path: Path, value: str, says: str) -> None:
    key = "sys__module__pinctrl_bcm2835__parameters__persist_gpio_outputs"
    assert says in " ".join(machine.facts(lay_out(tmp_path, **{key: value})))


def test_what_cannot_be_read_is_unknown_and_not_assumed(tmp_path: Path) -> None:
    told = machine.facts(tmp_path)
    assert "model: unknown" in told
    assert "real-time throttling: unknown" in told
    assert any("does not say" in fact for fact in told)


@pytest.mark.parametrize(
    ("runtime", "says"),
    [("-1", "off"), ("950000", "950000 us of every 1000000 us")],
)
def test_the_real_time_throttle_is_told(tmp_path: Path, runtime: str, says: str) -> None:
    here = lay_out(
        tmp_path,
        proc__sys__kernel__sched_rt_runtime_us=runtime,
        proc__sys__kernel__sched_rt_period_us="1000000",
    )
    assert f"real-time throttling: {says}" in machine.facts(here)


def test_a_machine_is_told_from_another_of_its_model_by_its_number(tmp_path: Path) -> None:
    path = lay_out(tmp_path / "1", **{f"{TREE}/serial-number": "10000000abcdef01\0"})
    other = lay_out(tmp_path / "2", **{f"{TREE}/serial-number": "10000000abcdef02\0"})
    assert machine.identity(path) != machine.identity(other)
    assert "abcdef01" not in machine.identity(path)


def test_a_machine_without_a_tree_is_told_by_its_systems_number(tmp_path: Path) -> None:
    here = lay_out(tmp_path / "1", **{"etc/machine-id": "0123\n"})
    assert len(machine.identity(here)) == 16
    assert machine.identity(tmp_path / "nowhere") == ""


def cores(root: Path, governor: str, least: str, most: str, now: str) -> Path:
    at = "sys__devices__system__cpu__cpu0__cpufreq__scaling_"
    found = {"governor": governor, "min_freq": least, "max_freq": most, "cur_freq": now}
    return lay_out(root, **{at + name: f"{text}\n" for name, text in found.items()})


def test_governor_and_frequency_of_the_cores_are_told(tmp_path: Path) -> None:
    here = cores(tmp_path, "ondemand", "600000", "1800000", "700000")
    assert machine.cpu_clock(here) == CpuClock("ondemand", 600_000, 1_800_000, 700_000)
    told = "cores: governor ondemand, 600 to 1800 MHz, now 700 MHz"
    assert told in machine.facts(here)


def test_cores_without_a_governor_are_not_guessed_at(tmp_path: Path) -> None:
    assert machine.cpu_clock(tmp_path) is None
    assert machine.cpu_clock(cores(tmp_path, "performance", "600000", "", "700000")) is None
    assert any(
        fact.startswith("cores: this kernel does not say") for fact in machine.facts(tmp_path)
    )
