"""`etd safe` on the kernel's lines, whatever else is missing.

Owns: what is driven then, and what is said. The kernel's end of gpiod and of the ioctl is a
stand-in; there is no SPI and no I2C.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path

import pytest

from etd import cli
from etd.files.as_started import keep_as_started
from etd.files.paths import board_as_started_file
from etd.files.resources import find
from etd_hal.boardfile import BoardFile
from etd_hal.errors import BusError
from etd_hal.linux import opening as linux
from etd_hal.linux.spi import LinuxSpi
from gpiod_kernel import ChipFile, Kernel

gpiod = pytest.importorskip("gpiod", reason="gpiod is there on Linux only")

from etd_hal.linux import gpio as linux_gpio  # noqa: E402

#: Lines of the reference board.
POL, BL, DATA, CLK, LE, HV, STOP = 4, 23, 5, 24, 22, 25, 17
SAFE = ("safe", "--board", "reference-hv507", "--machine")


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Kernel:
    """A Raspberry Pi's header, and nothing else of one."""
    kernel = Kernel()
    driver = functools.partial(linux_gpio.LinuxGpio, ioctl=kernel.ioctl)
    monkeypatch.setattr(linux_gpio, "LinuxGpio", driver)
    monkeypatch.setattr(gpiod, "request_lines", kernel.request_lines)
    monkeypatch.setattr(gpiod, "Chip", ChipFile)
    monkeypatch.setattr(linux_gpio, "DEVICES", tmp_path)
    monkeypatch.setattr(linux, "_open_spi", no_spi)
    (tmp_path / "gpiochip0").write_text("pinctrl-bcm2711")
    return kernel


def no_spi(board: BoardFile) -> LinuxSpi:
    """Whatever there is on the machine that runs the tests."""
    raise BusError("absent", board.source.spi, "soft_start")


def clocked_in(kernel: Kernel) -> list[int]:
    """DATA at each rise of CLK."""
    data, found = 0, []
    for write in kernel.granted[0].writes:
        data = write.get(DATA, data)
        if write.get(CLK) == 1:
            found.append(data)
    return found


def test_a_name_that_leads_to_another_folder_is_misuse(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["safe", "--name", "../../x"])
    assert ended.value.code == 2
    assert "1 to 32 letters" in capsys.readouterr().err


@pytest.mark.parametrize("machine", ["pi3", "pi4", "no-such-machine"])
def test_without_spi_and_on_any_machine_the_lines_are_driven_to_the_safe_state(
    kernel: Kernel, machine: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*SAFE, machine]) == 1

    outputs = kernel.granted[0]
    assert outputs.writes[0] == {POL: 1, BL: 0, HV: 0}
    assert clocked_in(kernel)[:64] == [0] * 64
    assert outputs.levels[LE] == 0
    told = capsys.readouterr()
    assert "NOT SAFE" in told.err
    assert "/dev/spidev0.0" in told.err
    assert "cut the supply by hand" in told.err
    assert ("the machine file is ignored" in told.err) is (machine == "no-such-machine")
    assert "safe (" not in told.out


def test_what_could_not_be_done_is_told_once(
    kernel: Kernel, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*SAFE, "pi4", "--json"]) == 1

    answer = json.loads(capsys.readouterr().out)
    assert (answer["ok"], answer["backend"]) == (False, "linux")
    assert len(answer["problems"]) == len(set(answer["problems"]))
    assert any("reaching the DAC" in problem for problem in answer["problems"])


def test_a_stop_line_that_somebody_holds_does_not_keep_the_outputs_from_being_driven(
    kernel: Kernel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kernel.busy = {STOP}
    (tmp_path / "gpiochip0").write_text(f"pinctrl-bcm2711\n{STOP} other")

    assert cli.main([*SAFE, "pi4"]) == 1

    driven = kernel.granted[-1]
    assert {POL: 1, BL: 0, HV: 0} in driven.writes
    assert "(17) is held by 'other'" in capsys.readouterr().err


def test_only_lines_that_cannot_be_had_are_a_refusal(
    kernel: Kernel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gpiochip0").write_text(f"pinctrl-bcm2711\n{POL} etd")

    assert cli.main([*SAFE, "pi4"]) == 3

    told = capsys.readouterr().err
    assert "POL (4) is held by 'etd'" in told
    assert "etd stop" in told
    assert kernel.granted == []


def test_settings_that_name_the_fake_by_now_leave_the_board_that_an_engine_has_driven_a_real_one(
    kernel: Kernel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = tmp_path / "main.toml"
    settings.write_text('backend = "fake"\nboard = "reference-hv507"\nmachine = "pi4"\n')
    asked = ["safe", "--config", str(settings), "--state", str(tmp_path)]
    assert cli.main(asked) == 0
    assert "nothing to do" in capsys.readouterr().out
    keep_as_started(
        board_as_started_file("main", "linux", tmp_path), find("boards", "reference-hv507")
    )

    cli.main(asked)

    assert kernel.granted[0].writes[0] == {POL: 1, BL: 0, HV: 0}
    told = capsys.readouterr()
    assert "the board is made safe as the engine was started with it" in told.err
    assert "nothing to do" not in told.out
