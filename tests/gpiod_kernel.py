"""What gpiod asks of a kernel: chips that are plain files, and line requests that are granted.

Owns: stand-ins for gpiod's Chip and request_lines, and the levels that a request begins with.
Must not know: the drivers under test.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

from wire_kernel import HeldRequest


class ChipFile:
    """A chip whose device is a plain file: its first line is the label, then LINE CONSUMER."""

    def __init__(self, path: str) -> None:
        label, *held = Path(path).read_text().splitlines()
        if label in ("EACCES", "ENODEV"):
            number = getattr(errno, label)
            raise OSError(number, "as told")
        self.label = label
        self.held = dict(line.split() for line in held)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def get_info(self) -> SimpleNamespace:
        return SimpleNamespace(label=self.label)

    def get_line_info(self, line: int) -> SimpleNamespace:
        used = str(line) in self.held
        return SimpleNamespace(offset=line, used=used, consumer=self.held.get(str(line), ""))


@dataclass
class Kernel:
    """Grants requests, or refuses those for the lines in `busy`."""

    busy: set[int] = field(default_factory=set)
    granted: list[HeldRequest] = field(default_factory=list)
    event_buffer_size: int | None = None

    def request_lines(
        self, path: str, consumer: str, config: dict[int, Any], event_buffer_size: int | None = None
    ) -> HeldRequest:
        self.event_buffer_size = event_buffer_size
        if self.busy & set(config):
            raise OSError(errno.EBUSY, "as told")
        levels = {line: int(entry.output_value.value) for line, entry in config.items()}
        self.granted.append(HeldRequest(10 + len(self.granted), list(config), levels))
        return self.granted[-1]

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> int:
        """To whichever request has this file descriptor."""
        (held,) = [held_request for held_request in self.granted if held_request.fd == fd]
        return held.ioctl(fd, request, buffer)
