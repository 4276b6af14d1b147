"""What calls and computing cost on each modelled machine: the fake's only source of durations.

Owns: the figures. Must not know: boards, chips, clocks.

The figures are a model, not a measurement. They are put together from the delay rules of the
kernel's SPI core (delays up to 10 us are busy-waited, longer ones slept), the byte timing of the
spi-bcm2835 driver (9 clock periods a byte), and published times of single GPIO calls: 4.4 us on a
Pi 4, 10.8 us on a Zero 2 W. What the kernel computes of a message is taken to be twice as long on
the slower cores (Cortex-A53 instead of A72). docs/benchmarks.md says how uncertain `slowness` is.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

_CLOCKS_PER_BYTE = 9
_LONGEST_BUSY_WAIT_US = 10
_OVERSLEEP_NS = 50_000
_I2C_BIT_NS = 10_000
_BY_CLOCK = (
    "message_before_ns",
    "message_after_ns",
    "cs_fall_ns",
    "cs_to_clock_ns",
    "cs_rise_ns",
    "empty_transfer_ns",
)


@dataclass(frozen=True, slots=True)
class MachineModel:
    """All in ns unless the name says otherwise."""

    #: One set or get call on GPIO lines.
    gpio_call_ns: int
    #: From the start of the call to the change of its first line, and from line to line.
    gpio_first_line_ns: int
    gpio_next_line_ns: int
    #: An SPI message before its first chip select, and after its last.
    message_before_ns: int
    message_after_ns: int
    cs_fall_ns: int
    cs_to_clock_ns: int
    cs_rise_ns: int
    #: A transfer without data, on top of its delay.
    empty_transfer_ns: int
    #: Laying a message out in memory: what the driver computes the first time that it is sent.
    #: Measured in an engine's loop on PCs: 16 to 29 us for a pulse of 11 transfers, 23 to 45 us for
    #: one of 21.
    layout_ns: int
    layout_transfer_ns: int
    i2c_call_ns: int
    #: How many times as long computing takes as on the PCs that the program is tested on.
    slowness: float
    #: How late a real-time thread wakes up from a sleep on a core of its own: assumed.
    wake_late_ns: int
    #: `cs_change`: chip select stays inactive for this long; spidev cannot choose.
    cs_change_ns: int = 10_000
    #: How many times as long a byte takes on the wire as at the speed that was set.
    clock_factor: float = 1.0

    def wake_late(self) -> int:
        """Of the next wake-up: always as late."""
        return self.wake_late_ns

    def slowed(self, factor: float) -> MachineModel:
        """With clocks that are so many times slower: all of a message takes longer but its waits,
        which a counter of their own times.
        """
        slower = {name: round(getattr(self, name) * factor) for name in _BY_CLOCK}
        return dataclasses.replace(self, clock_factor=factor, **slower)

    def clocking_ns(self, byte_count: int, speed_hz: int) -> int:
        """How long `byte_count` bytes take on the wire."""
        wire_ns = _CLOCKS_PER_BYTE * byte_count * 1_000_000_000 / speed_hz
        return round(wire_ns * self.clock_factor)

    def delay_ns(self, delay_us: int) -> int:
        """A delay inside a message: exact up to 10 us, above that slept, and overslept."""
        if delay_us <= _LONGEST_BUSY_WAIT_US:
            return delay_us * 1_000
        return delay_us * 1_100 + _OVERSLEEP_NS

    def laying_out_ns(self, transfer_count: int) -> int:
        """Laying out a message of so many transfers."""
        return self.layout_ns + self.layout_transfer_ns * transfer_count

    def i2c_ns(self, write_length: int, read_length: int) -> int:
        """A transaction at 100 kHz: 9 bits a byte, the address once or (with a restart) twice."""
        addresses = bool(write_length) + bool(read_length)
        bits = 9 * (write_length + read_length + addresses) + addresses + 1
        return self.i2c_call_ns + bits * _I2C_BIT_NS


PI4 = MachineModel(
    gpio_call_ns=4_400,
    gpio_first_line_ns=3_000,
    gpio_next_line_ns=50,
    message_before_ns=5_000,
    message_after_ns=3_000,
    cs_fall_ns=400,
    cs_to_clock_ns=3_000,
    cs_rise_ns=700,
    empty_transfer_ns=300,
    layout_ns=48_000,
    layout_transfer_ns=4_000,
    i2c_call_ns=40_000,
    slowness=4.0,
    wake_late_ns=10_000,
)

_A53 = MachineModel(
    gpio_call_ns=10_800,
    gpio_first_line_ns=7_000,
    gpio_next_line_ns=100,
    message_before_ns=10_000,
    message_after_ns=6_000,
    cs_fall_ns=800,
    cs_to_clock_ns=6_000,
    cs_rise_ns=1_400,
    empty_transfer_ns=600,
    layout_ns=96_000,
    layout_transfer_ns=8_000,
    i2c_call_ns=80_000,
    slowness=8.0,
    wake_late_ns=20_000,
)

#: By the names of the shipped machine files.
MACHINES = {
    "pi4": PI4,
    "pi3": _A53,
    "zero2w": dataclasses.replace(_A53, slowness=10.0),
}
