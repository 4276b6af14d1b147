"""Hardware that comes late is waited for; what does not come is not waited for long."""

from __future__ import annotations

import pytest

from etd_hal.errors import HardwareMissing
from etd_hal.fake.clock import SteppedClock
from etd_hal.wait_for_devices import open_when_there

CLOSED = "opening on /dev/gpiochip0 failed (permission); join the groups"
ABSENT = "opening on /dev/i2c-1 failed (absent); switch the bus on"
HELD = "POL (4) is held by 'etd'; end the program"
WAIT_NS = 10_000_000_000


class Devices:
    """Opened once all is there: a problem each, and until when, in ms after the start."""

    def __init__(self, *, may_come: bool = True, **until_ms: int) -> None:
        self.clock = SteppedClock()
        self.begun_ns = self.clock.now_ns()
        self.may_come = may_come
        self.until_ms = {
            {"closed": CLOSED, "absent": ABSENT, "held": HELD}[key]: ms
            for key, ms in until_ms.items()
        }
        self.looks = 0
        self.told: list[str] = []

    @property
    def passed_ms(self) -> float:
        return (self.clock.now_ns() - self.begun_ns) / 1e6

    def open_all(self) -> str:
        self.looks += 1
        missing = tuple(text for text, ms in self.until_ms.items() if self.passed_ms < ms)
        if missing:
            raise HardwareMissing(missing, self.may_come)
        return "ports"

    def wait(self, wait_ns: int = WAIT_NS) -> str:
        return open_when_there(self.open_all, self.clock, wait_ns, self.told.append)


def test_what_is_there_is_opened_at_once_and_nothing_is_said() -> None:
    devices = Devices()
    assert devices.wait() == "ports"
    assert (devices.passed_ms, devices.told) == (0, [])


def test_a_device_that_gets_its_permission_two_seconds_late_is_opened_then() -> None:
    devices = Devices(closed=2_000)
    assert devices.wait() == "ports"
    assert 2_000 <= devices.passed_ms <= 2_300
    assert devices.looks < 15
    waiting, there = devices.told
    assert waiting == f"waiting 10.0 s at most for: {CLOSED}"
    assert there == "all devices are there after 2.0 s"


def test_each_change_of_what_is_missing_is_said_and_nothing_twice() -> None:
    devices = Devices(closed=3_000, absent=1_000)
    devices.wait()
    first, second, _ = devices.told
    assert CLOSED in first
    assert ABSENT in first
    assert second == f"waiting 9.0 s at most for: {CLOSED}"


def test_what_never_comes_is_a_refusal_after_the_time_and_not_before() -> None:
    devices = Devices(absent=1_000_000)
    with pytest.raises(HardwareMissing, match="switch the bus on"):
        devices.wait()
    assert devices.passed_ms == 10_000


def test_what_no_waiting_brings_is_a_refusal_at_once() -> None:
    devices = Devices(may_come=False, held=2_000)
    with pytest.raises(HardwareMissing, match="is held by"):
        devices.wait()
    assert (devices.looks, devices.passed_ms) == (1, 0)


def test_without_a_time_nothing_is_waited_for() -> None:
    devices = Devices(closed=1)
    with pytest.raises(HardwareMissing):
        devices.wait(0)
    assert (devices.looks, devices.told) == (1, [])
