"""The kernel's own record of what went over the buses, as records that the trace decoder reads.

Owns: switching the trace events on and off, and reading their text. It imports nothing of the
project: whatever the program believes about itself does not count here.
Must not know: words, chips, what a pulse is.

Events: spi:* of the kernel's SPI core, and rig:rig_line of our GPIO chip (one for each call of its
set(), in order). Their clock is CLOCK_MONOTONIC, to the microsecond.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TRACING = Path("/sys/kernel/tracing")
#: What is recorded.
EVENTS = (
    "spi/spi_message_start",
    "spi/spi_message_done",
    "spi/spi_transfer_start",
    "spi/spi_transfer_stop",
    "spi/spi_set_cs",
    "spi/spi_setup",
    "rig/rig_line",
)
_BUFFER_KB = 65_536
#: In the trace's own header: what is left, and what was written.
_ENTRIES = re.compile(r"entries-in-buffer/entries-written: (\d+)/(\d+)")
_LINE = re.compile(
    r"-(?P<pid>\d+) +\[\d+\] +\S+ +(?P<t>\d+\.\d+): (?P<name>\w+): (?P<rest>.*)$", re.MULTILINE
)
_HEX = re.compile(r"(tx|rx)=\[([0-9a-f-]*)\]")


@dataclass(frozen=True)
class Event:
    """One event: its time in whole us, name, and the rest of its line."""

    t_us: int
    name: str
    rest: str
    pid: int

    @property
    def tx(self) -> bytes:
        """What a transfer sends; empty where it sends nothing."""
        return self._bytes("tx")

    @property
    def rx(self) -> bytes:
        return self._bytes("rx")

    def _bytes(self, name: str) -> bytes:
        found = dict(_HEX.findall(self.rest)).get(name, "")
        return bytes.fromhex(found.replace("-", ""))

    @property
    def is_active(self) -> bool:
        """Of spi_set_cs: whether chip select becomes active."""
        return self.rest.split()[1] == "activate"


def begin(of: Sequence[str] = EVENTS, buffer_kb: int = _BUFFER_KB) -> None:
    """Start anew, with an empty buffer. The trace goes on until the machine ends.

    With fewer events a longer time fits into the buffer.
    """
    _write("tracing_on", "0")
    _write("trace_clock", "mono")
    _write("buffer_size_kb", str(buffer_kb))
    for event in EVENTS:
        _write(f"events/{event}/enable", "1" if event in of else "0")
    _write("trace", "")
    _write("tracing_on", "1")


def events() -> list[Event]:
    """All events since `begin`, in order. Fails if any was lost."""
    text = (TRACING / "trace").read_text()
    entries = _ENTRIES.search(text)
    assert entries is not None, "the trace does not say how many events it has"
    assert entries[1] == entries[2], f"the trace has holes: {entries[1]} of {entries[2]} are left"
    return [
        Event(round(float(found["t"]) * 1e6), found["name"], found["rest"], int(found["pid"]))
        for found in _LINE.finditer(text)
    ]


def messages(of: list[Event]) -> Iterator[list[Event]]:
    """The events of each SPI message, from its start to its end."""
    message: list[Event] | None = None
    for event in of:
        if event.name == "spi_message_start":
            assert message is None, "a message begins within another"
            message = []
        if message is not None and event.name.startswith("spi_"):
            message.append(event)
        if event.name == "spi_message_done":
            assert message is not None, "the end of a message without a start"
            yield message
            message = None
    assert message is None, "a message that began did not end"


def levels(of: list[Event]) -> dict[int, int]:
    """By line, the level that the chip was told last."""
    told = (event.rest.split() for event in of if event.name == "rig_line")
    return {int(line): int(level) for line, level in told}


@dataclass(frozen=True)
class Taken:
    """An SPI message that ended: its words, its transfers without data, and how long it took."""

    words: int
    delays: int
    duration_us: int


def durations_us(of: list[Event]) -> Iterator[Taken]:
    """Of each SPI message that ended, in order."""
    begun_us = words = delays = 0
    for event in of:
        match event.name:
            case "spi_message_start":
                begun_us, words, delays = event.t_us, 0, 0
            case "spi_transfer_start" if event.rest.endswith("tx=[] rx=[]"):
                delays += 1
            case "spi_transfer_start":
                words += 1
            case "spi_message_done":
                yield Taken(words, delays, event.t_us - begun_us)


def records(of: list[Event], header: dict[str, Any]) -> list[dict[str, Any]]:
    """The same as the records of a bus trace: `header` and an event each.

    Levels are taken where the chip's set() was called, words where the transfer was over.
    """
    found = [header]
    for event in of:
        record = _record(event)
        if record is not None:
            found.append({"t_ns": event.t_us * 1_000, **record})
    return found


def _record(event: Event) -> dict[str, Any] | None:
    match event.name:
        case "rig_line":
            line, value = map(int, event.rest.split())
            return {"bus": "gpio", "line": line, "value": value}
        case "spi_set_cs":
            return {"bus": "spi", "event": "cs", "active": event.is_active}
        case "spi_transfer_stop":
            return {
                "bus": "spi",
                "event": "transfer",
                "tx": event.tx.hex(),
                "rx": event.rx.hex(),
                "delay_us": 0,
                "cs_change": False,
            }
    return None


def _write(name: str, value: str) -> None:
    (TRACING / name).write_text(value)
