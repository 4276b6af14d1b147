"""GPIO lines as they reach the kernel."""

from __future__ import annotations

import errno
from collections import deque
from dataclasses import dataclass, field
from typing import cast

import pytest

from etd_hal.errors import BusError
from etd_hal.ports import Edge, InputLine, LineSetup
from wire_kernel import HeldRequest

gpiod = pytest.importorskip("gpiod", reason="gpiod is there on Linux only")

from etd_hal.linux import gpio as linux_gpio  # noqa: E402

RISING, FALLING = 1, 2


@dataclass
class HeldInputs(HeldRequest):
    """Inputs whose edges wait in a queue, as in the kernel."""

    waiting: deque[tuple[int, int, int]] = field(default_factory=deque)

    def wait_edge_events(self, timeout: float) -> bool:
        assert timeout == 0
        return bool(self.waiting)

    def read_edge_events(self) -> list[object]:
        kind, t_ns, line = self.waiting.popleft()
        return [gpiod.EdgeEvent(kind, t_ns, line, 1, 1)]


@dataclass
class Chip:
    """Outputs POL 4, BL 23, CLK 24, in another order of request; inputs 17 and 18."""

    outputs: HeldRequest = field(
        default_factory=lambda: HeldRequest(10, [4, 23, 24, 5], {4: 1, 23: 0, 24: 0, 5: 0})
    )
    inputs: HeldInputs = field(default_factory=lambda: HeldInputs(11, [17, 18], {17: 1, 18: 0}))

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> int:
        return (self.outputs if fd == 10 else self.inputs).ioctl(fd, request, buffer)

    def driver(self) -> linux_gpio.LinuxGpio:
        inputs = cast(linux_gpio.EdgeSource, self.inputs)
        return linux_gpio.LinuxGpio("gpiochip0", self.outputs, inputs, self.ioctl)


def test_several_lines_change_in_one_call() -> None:
    chip = Chip()
    chip.driver().set(((23, 1), (4, 0)))
    assert chip.outputs.writes == [{4: 0, 23: 1}]


def test_the_same_changes_again_write_the_same_again() -> None:
    chip = Chip()
    driver = chip.driver()
    for _ in range(3):
        driver.set(((24, 1),))
        driver.set(((24, 0),))
    assert chip.outputs.writes == [{24: 1}, {24: 0}] * 3


def test_more_sets_of_changes_than_are_kept_are_all_written() -> None:
    chip = Chip()
    driver = chip.driver()
    wide = [
        tuple((line, at >> bit & 1) for bit, line in enumerate((4, 23, 24) * 4))
        for at in range(4096)
    ]
    for changes in wide:
        driver.set(changes)
    assert len(chip.outputs.writes) == 4096


def test_outputs_and_inputs_are_read_at_their_own_bits() -> None:
    driver = Chip().driver()
    assert [driver.get(line) for line in (4, 23, 17, 18)] == [1, 0, 1, 0]


@pytest.mark.parametrize("line", [17, 25])
def test_a_line_that_is_no_output_of_ours_is_refused(line: int) -> None:
    chip = Chip()
    with pytest.raises(BusError, match="not requested as an output") as caught:
        chip.driver().set(((4, 1), (line, 1)))
    assert caught.value.kind == "invalid"
    assert chip.outputs.writes == []


def test_a_line_that_was_not_requested_cannot_be_read() -> None:
    with pytest.raises(BusError, match="line 9") as caught:
        Chip().driver().get(9)
    assert caught.value.kind == "invalid"


def test_edges_come_oldest_first_with_the_kernels_time_and_only_once() -> None:
    chip = Chip()
    chip.inputs.waiting.extend([(FALLING, 1_000, 17), (RISING, 2_000, 17)])
    driver = chip.driver()
    assert driver.edges() == (Edge(17, 0, 1_000), Edge(17, 1, 2_000))
    assert driver.edges() == ()


def test_a_line_that_never_rests_does_not_hold_the_caller() -> None:
    """It has edges faster than they are read."""
    chip = Chip()
    chip.inputs.waiting.extend([(RISING, 1_000, 17)] * 5_000)
    driver = chip.driver()
    assert len(driver.edges()) == 1_024
    assert len(driver.edges()) == 1_024
    assert len(chip.inputs.waiting) == 5_000 - 2 * 1_024


def test_without_inputs_there_are_no_edges() -> None:
    chip = Chip()
    assert linux_gpio.LinuxGpio("gpiochip0", chip.outputs, None, chip.ioctl).edges() == ()


def test_a_chip_that_is_gone_is_a_bus_error_for_setting_and_reading() -> None:
    chip = Chip()
    chip.outputs.fail_errno = chip.inputs.fail_errno = errno.ENODEV
    driver = chip.driver()
    for call in (lambda: driver.set(((4, 1),)), lambda: driver.get(17)):
        with pytest.raises(BusError) as caught:
            call()
        assert caught.value.kind == "gone"


def test_closing_releases_outputs_and_inputs_and_leaves_nothing_to_write_to() -> None:
    chip = Chip()
    driver = chip.driver()
    driver.close()
    assert (chip.outputs.fd, chip.inputs.fd) == (-1, -1)
    with pytest.raises(BusError):
        driver.get(17)


def test_outputs_are_requested_in_the_order_given_with_their_levels() -> None:
    setup = LineSetup(outputs=((23, 0), (4, 1), (25, 0)))
    settings = linux_gpio.output_settings(setup)
    assert list(settings) == [23, 4, 25]
    assert [bool(setting.output_value) for setting in settings.values() if setting] == [
        False,
        True,
        False,
    ]


def test_inputs_get_their_pull_and_edges_in_monotonic_time() -> None:
    line = gpiod.line
    settings = linux_gpio.input_settings(
        (InputLine(17, "down", edges=True), InputLine(18, "up"), InputLine(19))
    )
    found = [(setting.bias, setting.edge_detection) for setting in settings.values() if setting]
    assert found == [
        (line.Bias.PULL_DOWN, line.Edge.BOTH),
        (line.Bias.PULL_UP, line.Edge.NONE),
        (line.Bias.DISABLED, line.Edge.NONE),
    ]
    assert {setting.event_clock for setting in settings.values() if setting} == {
        line.Clock.MONOTONIC
    }
