"""The driver's side of an SPI message: what the kernel takes, and the time to lay a message out.

Owns: the kernel's limits, and the note in a message that it is laid out (`Message.made`). A real
driver lays it out in the caller's process, so the time is spent there and not by the board.
Must not know: clocks, words, chips.

The limits are those of spidev on 64-bit Raspberry Pi OS: each transfer with data is rounded up to
128 bytes in a buffer of 4096, for tx and rx apart, and 512 transfers wrap to a message of none.
"""

from __future__ import annotations

from etd_hal.errors import BusError
from etd_hal.fake.machines import MachineModel
from etd_hal.ports import Message

_BUFFER_BYTES = 4_096
_ROUNDED_TO = 128
_WRAPS_AT = 512


def lay_out(message: Message, port: object, device: str, machine: MachineModel) -> int:
    """Note that `port` has laid the message out. Returns the ns it takes: 0 if it was noted before.

    Raises: BusError (invalid, too_long).
    """
    if port in message.made:
        return 0
    check_size(message, device)
    message.made[port] = None
    return machine.laying_out_ns(len(message.transfers))


def check_size(message: Message, device: str) -> None:
    """Raises: BusError (`invalid`, `too_long`)."""
    if len(message.transfers) >= _WRAPS_AT:
        detail = f"{len(message.transfers)} transfers wrap to a message of none"
        raise BusError("invalid", device, "transfer", detail)
    rounded = sum(-(-len(transfer.tx) // _ROUNDED_TO) for transfer in message.transfers)
    if rounded * _ROUNDED_TO > _BUFFER_BYTES:
        detail = f"{rounded} x {_ROUNDED_TO} bytes do not fit into {_BUFFER_BYTES}"
        raise BusError("too_long", device, "transfer", detail)
