"""The I2C bus of a board: rail monitor, set-point, and what the array's sensors are read with.

Owns: who answers at which address, and what goes wrong there.
Must not know: registers (`i2cchips.py`), who asks.
"""

from __future__ import annotations

from typing import Literal

from etd_hal.boardfile import BoardFile, RailMonitor
from etd_hal.errors import BusError
from etd_hal.fake.faults import MonitorStuck
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.i2cchips import Ads1115, I2cChip, Mcp4725
from etd_hal.fake.machines import MachineModel
from etd_hal.fake.pressure_sensors import FakePressureSensors
from etd_hal.fake.rail import Rail
from etd_hal.fake.timeline import Timeline
from etd_hal.fake.trace import Trace

#: How long the kernel waits for a stuck I2C bus.
_TIMEOUT_NS = 1_000_000_000


class I2cBus:
    def __init__(
        self,
        board: BoardFile,
        rail: Rail,
        faults: Faults,
        pressed: FakePressureSensors,
        timeline: Timeline,
        trace: Trace,
        machine: MachineModel,
    ) -> None:
        self._device = board.i2c
        self._faults = faults
        self._timeline = timeline
        self._trace = trace
        self._machine = machine
        monitor = board.guards.rail_monitor
        addresses = set(pressed.addresses)
        if monitor != "absent":
            addresses.add(monitor.address)
        self._chips: dict[int, I2cChip] = {
            address: Ads1115(_Inputs(address, monitor, rail, pressed, faults).volts)
            for address in addresses
        }
        if board.rail_setpoint != "absent":
            self._chips[board.rail_setpoint.address] = Mcp4725(rail.set_point, rail.woken_code)

    def transfer(
        self, t_ns: int, address: int, write: bytes, read_length: int
    ) -> tuple[bytes | BusError, int]:
        """The bytes read, or what went wrong; and when the transaction ends.

        The board's time does not wait for it: it runs beside the other buses.
        """
        t_ns = self._timeline.start(t_ns)
        fault = self._faults.i2c(address)
        chip = self._chips.get(address)
        if fault is not None or chip is None:
            kind = "absent" if fault is None else fault.kind
            lasts_ns = _TIMEOUT_NS if kind == "timeout" else self._machine.i2c_ns(0, 0)
            self._timeline.end(t_ns)
            device = f"{self._device}, address 0x{address:02x}"
            return BusError(kind, device, "transfer"), t_ns + lasts_ns
        if write:
            chip.write(t_ns, write)
        read = chip.read(t_ns, read_length) if read_length else b""
        self._trace.i2c(t_ns, address, write, read)
        self._timeline.end(t_ns)
        return read, t_ns + self._machine.i2c_ns(len(write), read_length)


class _Inputs:
    """Of one chip: the rail behind its divider where the monitor is, sensors on the others."""

    def __init__(
        self,
        address: int,
        monitor: RailMonitor | Literal["absent"],
        rail: Rail,
        pressed: FakePressureSensors,
        faults: Faults,
    ) -> None:
        self._address = address
        self._monitor = monitor
        self._rail = rail
        self._pressed = pressed
        self._faults = faults

    def volts(self, t_ns: int, channel: int) -> float:
        monitor = self._monitor
        if monitor == "absent" or (self._address, channel) != (monitor.address, monitor.channel):
            return self._pressed.volts(t_ns, self._address, channel)
        rail_v = self._rail.volts(t_ns)
        for stuck in self._faults.of(MonitorStuck):
            rail_v = stuck.rail_v
        return rail_v / monitor.divider
