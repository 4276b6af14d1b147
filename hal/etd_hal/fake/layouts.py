"""The driver's side of an SPI message: what the kernel takes, and which messages are laid out.

Owns: the kernel's limits, and the time that laying out a message takes when it is not kept. A real
driver computes it in the caller's process, so it is spent there and not by the board.
Must not know: clocks, words, chips.

The limits are those of spidev on 64-bit Raspberry Pi OS: each transfer with data is rounded up to
128 bytes in a buffer of 4096, for tx and rx apart, and 512 transfers wrap to a message of none.
"""

from __future__ import annotations

from etd_hal.errors import BusError
from etd_hal.fake import pi4
from etd_hal.ports import Message

_BUFFER_BYTES = 4_096
_ROUNDED_TO = 128
_WRAPS_AT = 512
#: As the kernel's driver keeps (`linux/spi.py`), so that the same messages are missed here.
_KEPT = 1024


class Layouts:
    """The messages that are laid out; beyond so many the oldest goes, unless it is lasting."""

    def __init__(self, device: str) -> None:
        self._device = device
        #: In the order in which they came.
        self._kept: dict[Message, None] = {}
        self._lasting: set[Message] = set()

    def take_ns(self, message: Message, *, is_lasting: bool = False) -> int:
        """How long laying it out takes now, after which it is kept: nothing if it was.

        Raises: BusError (invalid, too_long).
        """
        if message in self._lasting or (message in self._kept and not is_lasting):
            return 0
        check_size(message, self._device)
        if is_lasting:
            self._lasting.add(message)
        else:
            self._keep(message)
        return pi4.layout_ns(len(message.transfers))

    def _keep(self, message: Message) -> None:
        if len(self._kept) >= _KEPT:
            del self._kept[next(iter(self._kept))]
        self._kept[message] = None


def check_size(message: Message, device: str) -> None:
    """Raises: BusError (`invalid`, `too_long`)."""
    if len(message.transfers) >= _WRAPS_AT:
        detail = f"{len(message.transfers)} transfers wrap to a message of none"
        raise BusError("invalid", device, "transfer", detail)
    rounded = sum(-(-len(transfer.tx) // _ROUNDED_TO) for transfer in message.transfers)
    if rounded * _ROUNDED_TO > _BUFFER_BYTES:
        detail = f"{rounded} x {_ROUNDED_TO} bytes do not fit into {_BUFFER_BYTES}"
        raise BusError("too_long", device, "transfer", detail)
