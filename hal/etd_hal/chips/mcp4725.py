"""MCP4725, the 12-bit DAC that sets the rail.

Owns: its fast write and its reads. Must not know: what the volts do.

The value in its EEPROM is the output at power-up and must be zero; nothing here writes it.
"""

from __future__ import annotations

from etd_hal.errors import BoardFault
from etd_hal.ports import I2c


def write(i2c: I2c, address: int, code: int) -> None:
    """Set the output and read it back.

    Raises: ValueError (a code outside 0..4095), BusError, BoardFault (it holds another value).
    """
    if not 0 <= code <= 4095:
        raise ValueError(f"MCP4725 code {code} is outside 0..4095")
    i2c.transfer(address, code.to_bytes(2, "big"), 0)
    held = read(i2c, address)
    if held != code:
        raise BoardFault("MCP4725 rail set-point", str(held), str(code))


def read(i2c: I2c, address: int) -> int:
    """The code that its output has now (the status byte comes first). Raises: BusError."""
    received = i2c.transfer(address, b"", 3)
    return received[1] << 4 | received[2] >> 4


def read_power_up(i2c: I2c, address: int) -> int:
    """The code that its EEPROM holds, which is its output after power-up. Raises: BusError."""
    received = i2c.transfer(address, b"", 5)
    return (received[3] & 0x0F) << 8 | received[4]
