"""Finding the chip and requesting its lines: what gpiod is asked, and what its answers become."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from etd_hal.boardfile import load_board
from etd_hal.errors import BusError
from etd_hal.linux import opening as linux
from etd_hal.ports import InputLine, LineSetup
from gpiod_kernel import ChipFile, Kernel

gpiod = pytest.importorskip("gpiod", reason="gpiod is there on Linux only")

from etd_hal.linux import gpio as linux_gpio  # noqa: E402

KAJIMOTO = Path(__file__).parents[2] / "config" / "boards" / "kajimoto-hv507.toml"
SETUP = LineSetup(outputs=((23, 0), (4, 1)), inputs=(InputLine(17, "down", edges=True),))


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Kernel:
    kernel = Kernel()
    monkeypatch.setattr(gpiod, "request_lines", kernel.request_lines)
    monkeypatch.setattr(gpiod, "Chip", ChipFile)
    return kernel


@pytest.fixture
def devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Lays out the chips of a machine."""
    monkeypatch.setattr(linux_gpio, "DEVICES", tmp_path)

    def make(*chips: str) -> Path:
        for number, text in enumerate(chips):
            (tmp_path / f"gpiochip{number}").write_text(text)
        return tmp_path

    return make


Devices = Callable[..., Path]


def test_the_chip_is_found_by_its_label_whatever_its_number(
    kernel: Kernel, devices: Devices
) -> None:
    folder = devices("raspberrypi-exp-gpio", "ENODEV", "pinctrl-bcm2711")
    found = linux_gpio.find_chip(("pinctrl-bcm2711", "pinctrl-bcm2835"))
    assert found == folder / "gpiochip2"


def test_without_the_label_the_labels_there_are_are_told(kernel: Kernel, devices: Devices) -> None:
    devices("one", "two")
    with pytest.raises(BusError, match="there are one, two") as caught:
        linux_gpio.find_chip(("pinctrl-bcm2711",))
    assert caught.value.kind == "absent"


def test_no_chip_at_all_is_told(kernel: Kernel, devices: Devices) -> None:
    devices()
    with pytest.raises(BusError, match="no GPIO chip at all"):
        linux_gpio.find_chip(("pinctrl-bcm2711",))


def test_a_chip_that_may_not_be_opened_is_a_matter_of_permission(
    kernel: Kernel, devices: Devices
) -> None:
    devices("EACCES", "other")
    with pytest.raises(BusError) as caught:
        linux_gpio.find_chip(("pinctrl-bcm2711",))
    assert caught.value.kind == "permission"


def test_holders_are_those_of_the_lines_asked_for(kernel: Kernel, devices: Devices) -> None:
    chip = devices("pinctrl-bcm2711\n4 etd\n9 other") / "gpiochip0"
    assert linux_gpio.holders(chip, [4, 23]) == {4: "etd"}


def test_outputs_are_one_request_in_the_order_given_and_inputs_another(kernel: Kernel) -> None:
    driver = linux_gpio.open_gpio(Path("gpiochip0"), SETUP)
    assert [request.offsets for request in kernel.granted] == [[23, 4], [17]]
    driver.close()


def test_the_kernel_is_asked_for_the_longest_queue_of_edges(kernel: Kernel) -> None:
    """By itself it keeps 16 a line, of all inputs together."""
    linux_gpio.open_gpio(Path("gpiochip0"), SETUP).close()
    assert kernel.event_buffer_size == 1_024


def test_when_the_inputs_are_busy_the_outputs_are_given_back(kernel: Kernel) -> None:
    kernel.busy = {17}
    with pytest.raises(BusError) as caught:
        linux_gpio.open_gpio(Path("gpiochip0"), SETUP)
    assert caught.value.kind == "busy"
    assert kernel.granted[0].fd == -1


def test_busy_outputs_leave_nothing_requested(kernel: Kernel) -> None:
    kernel.busy = {4}
    with pytest.raises(BusError) as caught:
        linux_gpio.open_gpio(Path("gpiochip0"), SETUP)
    assert caught.value.kind == "busy"
    assert kernel.granted == []


def test_the_lines_can_be_had_when_all_else_is_gone(kernel: Kernel, devices: Devices) -> None:
    devices("pinctrl-bcm2835")
    driver = linux.open_lines(load_board(KAJIMOTO), SETUP)
    assert kernel.granted[0].offsets == [23, 4]
    driver.close()


def test_lines_that_somebody_holds_are_told_by_function_and_holder(
    kernel: Kernel, devices: Devices
) -> None:
    devices("pinctrl-bcm2711\n4 etd")
    with pytest.raises(BusError, match=r"POL \(4\) is held by 'etd'") as caught:
        linux.open_lines(load_board(KAJIMOTO), SETUP)
    assert caught.value.kind == "busy"
    assert kernel.granted == []


class ChipWithPins(ChipFile):
    """Of a line that is held it tells which way the pin points; of a free one, how it was used."""

    kernel: Kernel

    def get_line_info(self, line: int) -> SimpleNamespace:
        ways = gpiod.line.Direction
        is_held = any(line in held.offsets for held in self.kernel.granted if held.fd != -1)
        points_out = not is_held or (self.label == "pins that stay" and line == 4)
        return SimpleNamespace(offset=line, direction=ways.OUTPUT if points_out else ways.INPUT)


@pytest.mark.parametrize(
    ("label", "stay"), [("pins that stay", True), ("pins that become inputs", False)]
)
def test_what_becomes_of_outputs_is_seen_by_letting_go_of_them_once(
    kernel: Kernel, devices: Devices, monkeypatch: pytest.MonkeyPatch, label: str, stay: bool
) -> None:
    monkeypatch.setattr(gpiod, "Chip", ChipWithPins)
    monkeypatch.setattr(ChipWithPins, "kernel", kernel, raising=False)
    chip = devices(label) / "gpiochip0"
    assert linux_gpio.keeps_driving(chip, SETUP) is stay
    assert [request.fd for request in kernel.granted] == [-1, -1, -1]


def test_a_chip_that_goes_meanwhile_is_told(kernel: Kernel, devices: Devices) -> None:
    chip = devices("ENODEV") / "gpiochip0"
    with pytest.raises(BusError) as caught:
        linux_gpio.keeps_driving(chip, SETUP)
    assert caught.value.kind == "gone"
