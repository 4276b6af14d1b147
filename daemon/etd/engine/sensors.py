"""The latest value of each slow sensor, with its time.

Owns: the rail and the pressure under the array, read over I2C in a thread of their own, because a
stuck bus can block for a second. A stale value is unknown.
Must not know: states, frames, what follows from a value.
"""

from __future__ import annotations

import threading

from etd.array import Array
from etd.errors import EtdError
from etd_hal.boardfile import BoardFile
from etd_hal.chips import ads1115, mcp4725
from etd_hal.ports import Clock, I2c

#: A value older than this says nothing.
STALE_NS = 500_000_000
_PERIOD_S = 0.02
_CONVERSION_S = ads1115.CONVERSION_NS / 1e9


class RailSensor:
    """Rail volts, where the board has a monitor; sets the rail, where it can be set."""

    def __init__(self, board: BoardFile, i2c: I2c | None, clock: Clock) -> None:
        self._monitor = board.guards.rail_monitor
        self._setpoint = board.rail_setpoint
        self._i2c = i2c
        self._clock = clock
        # One tuple, replaced whole: the scan thread never sees half a value.
        self._latest: tuple[float, int] | None = None
        self._is_set = self._setpoint == "absent"
        self._is_begun = False
        self.problem = ""

    @property
    def is_there(self) -> bool:
        return self._monitor != "absent"

    def rail_v(self, now_ns: int) -> float | None:
        """Volts, or None where unknown: no monitor, an error, or stale."""
        latest = self._latest
        if latest is None or now_ns - latest[1] > STALE_NS:
            return None
        return latest[0]

    def begin(self) -> None:
        """Set the rail (once), start a conversion. Never raises; `problem` tells."""
        self._is_begun = False
        if self._i2c is None:
            return
        try:
            if not self._is_set and self._setpoint != "absent":
                mcp4725.write(self._i2c, self._setpoint.address, self._setpoint.code)
                self._is_set = True
            if self._monitor != "absent":
                ads1115.start(self._i2c, self._monitor.address, self._monitor.channel)
                self._is_begun = True
        except EtdError as error:
            self._lost(error)

    def end(self) -> None:
        """Read the conversion begun a few milliseconds ago. Never raises. Where none was begun,
        what the chip holds is of another channel, and is not read.
        """
        if self._i2c is None or self._monitor == "absent" or not self._is_begun:
            return
        self._is_begun = False
        try:
            volts = ads1115.read_v(self._i2c, self._monitor.address) * self._monitor.divider
        except EtdError as error:
            self._lost(error)
        else:
            self._latest = (volts, self._clock.now_ns())
            self.problem = "" if self._is_set else self.problem

    def _lost(self, error: EtdError) -> None:
        self._latest = None
        self.problem = str(error)


class PressureSensors:
    """The pressure under each electrode, from the sensor nearest to it."""

    def __init__(self, array: Array, i2c: I2c | None, clock: Clock) -> None:
        self._sensors = array.pressure
        self._of_electrode = [array.nearest_pressure(one) for one in range(array.count)]
        self._i2c = i2c
        self._clock = clock
        # Tuples, replaced whole: the scan thread never sees half a value.
        self._latest: list[tuple[float, int] | None] = [None] * len(self._sensors)
        #: Whose conversion is under way.
        self._begun: int | None = None
        self.problem = ""

    @property
    def count(self) -> int:
        return len(self._sensors)

    def kpa(self, electrode: int, now_ns: int) -> float | None:
        """None where unknown: no sensor, an error, no plausible voltage, or stale."""
        sensor = self._of_electrode[electrode]
        latest = None if sensor is None else self._latest[sensor]
        if latest is None or now_ns - latest[1] > STALE_NS:
            return None
        return latest[0]

    def is_dead(self, electrode: int, now_ns: int) -> bool:
        """There is a sensor, and it says nothing."""
        return self._of_electrode[electrode] is not None and self.kpa(electrode, now_ns) is None

    def begin(self, sensor: int) -> None:
        """Start a conversion. Never raises; `problem` tells."""
        self._begun = None
        if self._i2c is None:
            return
        one = self._sensors[sensor]
        try:
            ads1115.start(self._i2c, one.address, one.channel)
        except EtdError as error:
            self._lost(sensor, str(error))
        else:
            self._begun = sensor

    def end(self, sensor: int) -> None:
        """Read the conversion begun a few milliseconds ago. Never raises. Where none of this sensor
        was begun, what the chip holds is of another channel, and is not read.
        """
        if self._i2c is None or self._begun != sensor:
            return
        self._begun = None
        one = self._sensors[sensor]
        try:
            volts = ads1115.read_v(self._i2c, one.address)
        except EtdError as error:
            self._lost(sensor, str(error))
            return
        if one.low_v <= volts <= one.high_v:
            kpa = max(0.0, (volts - one.zero_v) * one.kpa_per_v)
            self._latest[sensor] = (kpa, self._clock.now_ns())
            self.problem = ""
        else:
            self._lost(sensor, f"{volts:.2f} V, not {one.low_v} to {one.high_v} V")

    def _lost(self, sensor: int, problem: str) -> None:
        self._latest[sensor] = None
        self.problem = f"pressure sensor {sensor}: {problem}"


class SensorThread(threading.Thread):
    """Reads until told to end; one conversion at a time, since a chip has one converter."""

    def __init__(self, rail: RailSensor, pressure: PressureSensors) -> None:
        super().__init__(name="etd-sensors", daemon=True)
        self._rail = rail
        self._pressure = pressure
        self._ending = threading.Event()

    def run(self) -> None:
        while not self._ending.wait(_PERIOD_S):
            self._rail.begin()
            self._ending.wait(_CONVERSION_S)
            self._rail.end()
            for sensor in range(self._pressure.count):
                self._pressure.begin(sensor)
                self._ending.wait(_CONVERSION_S)
                self._pressure.end(sensor)

    def end(self) -> None:
        """Idempotent; waits for a blocked bus no longer than two seconds."""
        self._ending.set()
        self.join(timeout=2.0)
