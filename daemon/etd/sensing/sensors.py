"""The latest value of each slow sensor, with its time.

Owns: the rail and the pressure under the array, read over I2C beside the scan, because a stuck bus
can block for a second; and what a value with its age says. A stale value is unknown.
Must not know: states, frames, what follows from a value, where the values are kept (`readings.py`).

The same classes stand on both sides: where the bus is read `begin` and `end` are called, and where
the scan is driven the values are asked for. Both share their `Readings`.

The sensors may share a chip, and a chip has one converter: they convert in turn, and each reads the
conversion that it began, or an error.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

from etd.files.array import Array, PressureSensor
from etd.protocol.errors import EtdError
from etd.sensing.readings import Readings
from etd.sensing.scan_core import CORE_SLOT, ScanCoreReading
from etd_hal.boardfile import BoardFile
from etd_hal.chips import ads1115, mcp4725
from etd_hal.ports import Clock, I2c

#: A value older than this is unknown.
STALE_NS = 500_000_000
#: A momentary problem is reported for so long, so that a report each second does not miss it.
TOLD_NS = 2_000_000_000
_PERIOD_S = 0.02
_CONVERSION_S = ads1115.CONVERSION_NS / 1e9
#: In the readings: the rail, the scan's core, then the sensors under the array.
RAIL_SLOT, _FIRST_SLOT = 0, CORE_SLOT + 1


def slots_of(array: Array) -> int:
    """How many slots the readings of a board with this array have."""
    return _FIRST_SLOT + len(array.pressure)


class _Input:
    """One ADS1115 input: a conversion is begun, and polled until it is done. `lost` is called with
    the reason where that fails.
    """

    def __init__(
        self, i2c: I2c, address: int, channel: int, clock: Clock, lost: Callable[[str], None]
    ) -> None:
        self._i2c = i2c
        self._address = address
        self._channel = channel
        self._clock = clock
        self._lost = lost
        self._begun_ns: int | None = None

    def begin(self) -> None:
        """Never raises."""
        self._begun_ns = None
        try:
            ads1115.start(self._i2c, self._address, self._channel)
            self._begun_ns = self._clock.now_ns()
        except EtdError as error:
            self._lost(str(error))

    def end(self, take: Callable[[float], None]) -> bool:
        """Hand the volts of the conversion under way, if any, to `take`; False while it lasts: call
        again. Never raises.
        """
        begun_ns, self._begun_ns = self._begun_ns, None
        if begun_ns is None:
            return True
        try:
            volts = ads1115.read_v(self._i2c, self._address, self._channel)
            if volts is None and self._clock.now_ns() - begun_ns > ads1115.GIVE_UP_NS:
                raise ads1115.unfinished(self._address)
        except EtdError as error:
            self._lost(str(error))
            return True
        if volts is None:
            self._begun_ns = begun_ns
            return False
        take(volts)
        return True


class RailSensor:
    """Rail volts, where the board has a monitor; sets the rail, where it can be set."""

    def __init__(
        self, board: BoardFile, i2c: I2c | None, clock: Clock, readings: Readings | None = None
    ) -> None:
        """`readings`: its slot is the first; None: its own."""
        self._monitor = board.guards.rail_monitor
        self._setpoint = board.rail_setpoint
        self._i2c = i2c
        self._clock = clock
        self._readings = Readings(1) if readings is None else readings
        self._is_set = self._setpoint == "absent"
        self._input: _Input | None = None
        if i2c is not None and self._monitor != "absent":
            address, channel = self._monitor.address, self._monitor.channel
            self._input = _Input(i2c, address, channel, clock, self._lost)

    @property
    def problem(self) -> str:
        """Why it cannot be read; "" while it can."""
        return self._readings.told(RAIL_SLOT)[0]

    @property
    def is_there(self) -> bool:
        return self._monitor != "absent"

    def rail_v(self, now_ns: int) -> float | None:
        """Volts, or None where unknown: no monitor, an error, or stale."""
        latest = self._readings.latest(RAIL_SLOT)
        if latest is None or now_ns - latest[1] > STALE_NS:
            return None
        return latest[0]

    def begin(self) -> None:
        """Set the rail (once), start a conversion. Never raises; see `problem`."""
        if self._i2c is None:
            return
        try:
            if not self._is_set and self._setpoint != "absent":
                mcp4725.write(self._i2c, self._setpoint.address, self._setpoint.code)
                self._is_set = True
        except EtdError as error:
            self._lost(str(error))
            return
        if self._input is not None:
            self._input.begin()

    def end(self) -> bool:
        """See `_Input.end`."""
        return self._input is None or self._input.end(self._take)

    def _take(self, volts: float) -> None:
        if self._monitor != "absent":
            now_ns = self._clock.now_ns()
            self._readings.put(RAIL_SLOT, volts * self._monitor.divider, now_ns)
            if self._is_set:
                self._readings.tell(RAIL_SLOT, "", now_ns)

    def _lost(self, why: str) -> None:
        self._readings.lose(RAIL_SLOT)
        self._readings.tell(RAIL_SLOT, why, self._clock.now_ns())


class PressureSensors:
    """The pressure under each electrode, from the sensor nearest to it."""

    def __init__(
        self, array: Array, i2c: I2c | None, clock: Clock, readings: Readings | None = None
    ) -> None:
        """`readings`: its slots follow the rail's; None: its own."""
        self._sensors = array.pressure
        self._of_electrode = [array.nearest_pressure(electrode) for electrode in range(array.count)]
        self._clock = clock
        self._inputs: list[_Input] | None = None
        if i2c is not None:
            self._inputs = [
                _Input(i2c, sensor.address, sensor.channel, clock, partial(self._lost, index))
                for index, sensor in enumerate(self._sensors)
            ]
        self._readings = Readings(slots_of(array)) if readings is None else readings
        self._made_ns = clock.now_ns()

    @property
    def count(self) -> int:
        return len(self._sensors)

    def kpa(self, electrode: int, now_ns: int) -> float | None:
        """None where unknown: no sensor, an error, no plausible voltage, or stale."""
        sensor = self._of_electrode[electrode]
        latest = None if sensor is None else self._readings.latest(_FIRST_SLOT + sensor)
        if latest is None or now_ns - latest[1] > STALE_NS:
            return None
        return latest[0]

    def is_dead(self, electrode: int, now_ns: int) -> bool:
        """There is a sensor, and it has no valid reading."""
        return self._of_electrode[electrode] is not None and self.kpa(electrode, now_ns) is None

    def kpa_of_all(self, now_ns: int) -> tuple[float | None, ...]:
        """For reports: kPa at each electrode, None where unknown; () without any sensor."""
        if not self._sensors:
            return ()
        kpa = [self.kpa(electrode, now_ns) for electrode in range(len(self._of_electrode))]
        return tuple(None if value is None else round(value, 1) for value in kpa)

    def problems(self, now_ns: int) -> dict[str, str]:
        """The sensors without a valid reading, and why; also those of the last TOLD_NS."""
        why = {sensor: self._why_silent(sensor, now_ns) for sensor in range(len(self._sensors))}
        return {_name(sensor, self._sensors[sensor]): told for sensor, told in why.items() if told}

    def begin(self, sensor: int) -> None:
        """Start a conversion. Never raises; see `problems`."""
        if self._inputs is not None:
            self._inputs[sensor].begin()

    def end(self, sensor: int) -> bool:
        """See `_Input.end`."""
        return self._inputs is None or self._inputs[sensor].end(partial(self._take, sensor))

    def _take(self, index: int, volts: float) -> None:
        sensor = self._sensors[index]
        if sensor.low_v <= volts <= sensor.high_v:
            kpa = max(0.0, (volts - sensor.zero_v) * sensor.kpa_per_v)
            self._readings.put(_FIRST_SLOT + index, kpa, self._clock.now_ns())
        else:
            self._lost(index, f"it reads {volts:.2f} V, not {sensor.low_v} to {sensor.high_v} V")

    def _lost(self, sensor: int, why: str) -> None:
        self._readings.lose(_FIRST_SLOT + sensor)
        self._readings.tell(_FIRST_SLOT + sensor, why, self._clock.now_ns())

    def _why_silent(self, sensor: int, now_ns: int) -> str:
        """Empty for a sensor that works."""
        readings, slot = self._readings, _FIRST_SLOT + sensor
        latest, (wrong, wrong_ns) = readings.latest(slot), readings.told(slot)
        if wrong and (latest is None or now_ns - wrong_ns <= TOLD_NS):
            return wrong
        since_ns = self._made_ns if latest is None else latest[1]
        is_stale = now_ns - since_ns > STALE_NS
        return "it was not read for half a second: is the I2C bus stuck?" if is_stale else ""


def _name(index: int, sensor: PressureSensor) -> str:
    """As it stands in the array's file."""
    return f"pressure[{index}] (0x{sensor.address:02x}, channel {sensor.channel})"


class SensorCycle:
    """The order of conversions: the rail's monitor, then each sensor, each until it is done."""

    def __init__(self, rail: RailSensor, pressure: PressureSensors) -> None:
        sensors = range(pressure.count)
        self._begin: list[Callable[[], None]] = [rail.begin]
        self._begin += [partial(pressure.begin, sensor) for sensor in sensors]
        self._end: list[Callable[[], bool]] = [rail.end]
        self._end += [partial(pressure.end, sensor) for sensor in sensors]
        self._at = 0
        self._is_begun = False

    def step(self) -> bool:
        """Begin a conversion, or poll the one under way. True when the last of a round is over:
        then no conversion is under way.
        """
        if not self._is_begun:
            self._begin[self._at]()
            self._is_begun = True
        elif self._end[self._at]():
            self._is_begun = False
            self._at = (self._at + 1) % len(self._begin)
            if self._at == 0:
                return True
            return self.step()
        return False


class SensorThread(threading.Thread):
    """Reads the sensors of a board whose ports are in this process: a fake one's."""

    refusals: tuple[str, ...] = ()

    def __init__(
        self, rail: RailSensor, pressure: PressureSensors, scan_core: ScanCoreReading
    ) -> None:
        super().__init__(name="etd-sensors", daemon=True)
        self._cycle = SensorCycle(rail, pressure)
        self._scan_core = scan_core
        self._ending = threading.Event()

    def run(self) -> None:
        read_until(self._ending.wait, self._cycle, self._scan_core)

    def end(self) -> None:
        """Idempotent; waits for a blocked bus no longer than two seconds."""
        self._ending.set()
        self.join(timeout=2.0)


def read_until(
    is_over: Callable[[float], bool], cycle: SensorCycle, scan_core: ScanCoreReading
) -> None:
    """Reads in turn. `is_over` waits for so many seconds, which paces it (the chip says when a
    conversion is over), and returns True when reading is to end.
    """
    pause_s = _PERIOD_S
    scan_core.read()
    while not is_over(pause_s):
        scan_core.read()
        pause_s = _PERIOD_S if cycle.step() else _CONVERSION_S
