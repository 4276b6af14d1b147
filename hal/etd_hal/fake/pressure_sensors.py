"""What sensors under the array of a fake board put out.

Owns: which inputs of which ADS1115 they are on, and the volts there: of a finger that presses, or
what a test put there. Must not know: registers, what is made of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

#: (time in ns, place in mm) to kPa.
PressureModel = Callable[[int, tuple[float, float]], float]
#: What a finger that only conducts presses with: the mean of the one that lives.
LYING_KPA = 40.0


class SensorUnderArray(Protocol):
    """As an array file describes one: kPa = (volts - zero_v) x kpa_per_v."""

    @property
    def address(self) -> int: ...
    @property
    def channel(self) -> int: ...
    @property
    def x_mm(self) -> float: ...
    @property
    def y_mm(self) -> float: ...
    @property
    def zero_v(self) -> float: ...
    @property
    def kpa_per_v(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Sensor:
    """One that no array file describes."""

    address: int
    channel: int
    zero_v: float
    kpa_per_v: float
    x_mm: float = 0.0
    y_mm: float = 0.0

    @classmethod
    def of(cls, text: str) -> Sensor:
        """As in "0x49:2:0.5:100". Raises: ValueError."""
        address, channel, zero_v, kpa_per_v = text.split(":")
        return cls(int(address, 0), int(channel), float(zero_v), float(kpa_per_v))


def lying(_t_ns: int, _position_mm: tuple[float, float]) -> float:
    """A finger that lies there, always the same."""
    return LYING_KPA


class FakePressureSensors:
    """The inputs that are not the rail's own. One without a sensor is on ground."""

    def __init__(self, sensors: Sequence[SensorUnderArray], pressing: PressureModel) -> None:
        self._sensors = {(sensor.address, sensor.channel): sensor for sensor in sensors}
        self._pressing = pressing
        self._put_v: dict[tuple[int, int], float] = {}

    @property
    def addresses(self) -> frozenset[int]:
        """Of the chips that sensors are on."""
        return frozenset(address for address, _ in self._sensors)

    def press(self, kpa: float) -> None:
        """From now on this much everywhere, whatever the body does."""
        self._pressing = lambda _t_ns, _position_mm: kpa

    def put_v(self, address: int, channel: int, volts: float | None) -> None:
        """What an input is at, whatever presses there; None lets the sensor speak again."""
        if volts is None:
            self._put_v.pop((address, channel), None)
        else:
            self._put_v[address, channel] = volts

    def volts(self, t_ns: int, address: int, channel: int) -> float:
        put_v = self._put_v.get((address, channel))
        if put_v is not None:
            return put_v
        sensor = self._sensors.get((address, channel))
        if sensor is None:
            return 0.0
        kpa = self._pressing(t_ns, (sensor.x_mm, sensor.y_mm))
        return sensor.zero_v + kpa / sensor.kpa_per_v
