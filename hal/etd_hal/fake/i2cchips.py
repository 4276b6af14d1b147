"""ADS1115 and MCP4725 as they answer on the bus.

Owns: their registers. Typed from the datasheets, for the fake only.
Must not know: the drivers, what hangs on the inputs and outputs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class I2cChip(Protocol):
    def write(self, t_ns: int, data: bytes) -> None: ...

    def read(self, t_ns: int, length: int) -> bytes: ...


class Ads1115:
    """Four inputs, one converter, big-endian registers.

    `input_v(t_ns, channel)` is the voltage at an input. A conversion is of the instant it starts,
    and reads back when its period is over; until then OS reads 0 and the old result stays.
    """

    _FULL_SCALE_V = (6.144, 4.096, 2.048, 1.024, 0.512, 0.256, 0.256, 0.256)
    _RATES_HZ = (8, 16, 32, 64, 128, 250, 475, 860)
    _PAIRS = ((0, 1), (0, 3), (1, 3), (2, 3))
    _SUPPLY_V = 3.3
    _START = 0x8000
    _POWER_UP = 0x8583

    def __init__(self, input_v: Callable[[int, int], float]) -> None:
        self._input_v = input_v
        self._pointer = 0
        self._config = self._POWER_UP
        self._limits = [0x8000, 0x7FFF]
        self._result = 0
        self._pending: tuple[int, int] | None = None

    def write(self, t_ns: int, data: bytes) -> None:
        if not data:
            return
        self._settle(t_ns)
        self._pointer = data[0] & 3
        if len(data) < 3:
            return
        value = int.from_bytes(data[1:3], "big")
        if self._pointer == 1:
            self._configure(t_ns, value)
        elif self._pointer >= 2:
            self._limits[self._pointer - 2] = value

    def read(self, t_ns: int, length: int) -> bytes:
        self._settle(t_ns)
        registers = (self._result & 0xFFFF, self._config, *self._limits)
        word = registers[self._pointer].to_bytes(2, "big")
        return (word * (length // 2 + 1))[:length]

    def _configure(self, t_ns: int, value: int) -> None:
        continuous = not value & 0x0100
        starts = bool(value & self._START) or continuous
        self._config = value | self._START
        if starts:
            self._begin(t_ns)

    def _begin(self, t_ns: int) -> None:
        self._config &= ~self._START
        period_ns = 1_000_000_000 // self._RATES_HZ[self._config >> 5 & 7]
        self._pending = (t_ns + period_ns, self._convert(t_ns))

    def _settle(self, t_ns: int) -> None:
        if self._pending is None or t_ns < self._pending[0]:
            return
        due_ns, self._result = self._pending
        self._pending = None
        self._config |= self._START
        if not self._config & 0x0100:
            period_ns = 1_000_000_000 // self._RATES_HZ[self._config >> 5 & 7]
            missed = (t_ns - due_ns) // period_ns
            self._begin(due_ns + missed * period_ns)

    def _convert(self, t_ns: int) -> int:
        multiplexer = self._config >> 12 & 7
        if multiplexer >= 4:
            volts = self._at_input(t_ns, multiplexer - 4)
        else:
            plus, minus = self._PAIRS[multiplexer]
            volts = self._at_input(t_ns, plus) - self._at_input(t_ns, minus)
        code = round(volts / self._FULL_SCALE_V[self._config >> 9 & 7] * 32_768)
        return min(max(code, -32_768), 32_767)

    def _at_input(self, t_ns: int, channel: int) -> float:
        """An input cannot be lifted above the chip's supply."""
        return min(max(self._input_v(t_ns, channel), 0.0), self._SUPPLY_V)


class Mcp4725:
    """A 12-bit DAC; `on_code(t_ns, code)` is called when its output changes.

    The EEPROM holds what the output is after power-up, which must be 0 on a real board: `at_first`
    tells it, until a command writes it.
    """

    _READY = 0x80

    def __init__(
        self, on_code: Callable[[int, int], None], at_first: Callable[[], int] = int
    ) -> None:
        self._on_code = on_code
        self._at_first = at_first
        #: None: nothing has been written to it yet.
        self._written: int | None = None
        self._in_eeprom: int | None = None
        self._power_down = 0

    def write(self, t_ns: int, data: bytes) -> None:
        if len(data) < 2:
            return
        command = data[0] >> 5
        if command in (0, 1):
            self._power_down = data[0] >> 4 & 3
            self._written = (data[0] & 0x0F) << 8 | data[1]
        elif command in (2, 3) and len(data) >= 3:
            self._power_down = data[0] >> 1 & 3
            self._written = data[1] << 4 | data[2] >> 4
            if command == 3:
                self._in_eeprom = self._written
        self._on_code(t_ns, 0 if self._power_down else self._code)

    @property
    def _stored(self) -> int:
        return self._at_first() if self._in_eeprom is None else self._in_eeprom

    @property
    def _code(self) -> int:
        return self._stored if self._written is None else self._written

    def read(self, t_ns: int, length: int) -> bytes:  # noqa: ARG002 - one shape for all chips
        """Status, output register (2 bytes), then EEPROM (2 bytes)."""
        code, stored = self._code, self._stored
        answer = bytes(
            (
                self._READY | self._power_down << 1,
                code >> 4,
                code << 4 & 0xF0,
                stored >> 8,
                stored & 0xFF,
            )
        )
        return answer[:length].ljust(length, b"\xff")
