"""GPIO lines through gpiod: the package finds, requests and describes; the ioctl sets and gets.

Owns: which chip, which request holds which line, ready buffers for each set of changes, edges.
Must not know: what a line does.

Line numbers are those of the 40-pin header. One request holds the outputs, another the inputs, so
that each keeps its own order.
"""

from __future__ import annotations

import fcntl
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Protocol

import gpiod
from gpiod import line as gpiod_line

from etd_hal.errors import BusError
from etd_hal.linux import uapi
from etd_hal.ports import Changes, Edge, InputLine, LineSetup, Pull

#: As fcntl.ioctl: file descriptor, request number, buffer.
Ioctl = Callable[[int, int, bytearray], int]

#: Where chips are looked for.
DEVICES = Path("/dev")

#: What gpiod takes: by line number (it would take names and groups of lines as well).
Settings = dict[Iterable[int | str] | int | str, gpiod.LineSettings | None]

#: Events that the kernel keeps for the inputs: the most that it gives. A stop's edge shares the
#: queue with a trigger; by itself it would hold 16 a line, and drop the oldest.
_EDGES_KEPT = 1_024

#: So many different sets of changes are kept ready; beyond, the oldest goes.
_KEPT = 1024


class HeldLines(Protocol):
    """Requested lines: what gpiod's LineRequest is to us."""

    @property
    def fd(self) -> int: ...

    @property
    def offsets(self) -> Sequence[int]: ...

    def release(self) -> None: ...


class EdgeSource(HeldLines, Protocol):
    """Requested inputs that can tell their edges."""

    def wait_edge_events(self, timeout: float) -> bool: ...

    def read_edge_events(self) -> Sequence[gpiod.EdgeEvent]: ...


class LinuxGpio:
    """The Gpio port on lines that are held, which it releases.

    `set` may be called by two threads at once: what they share is written once and then only read.
    """

    def __init__(
        self,
        chip: str,
        outputs: HeldLines,
        inputs: EdgeSource | None,
        ioctl: Ioctl = fcntl.ioctl,
    ) -> None:
        self._chip = chip
        self._outputs = outputs
        self._inputs = inputs
        self._ioctl = ioctl
        self._output_fd = outputs.fd
        self._output_bit = {line: bit for bit, line in enumerate(outputs.offsets)}
        # A line of the request, by line: which file descriptor answers for it, and as which bit.
        self._held = {line: (outputs.fd, bit) for line, bit in self._output_bit.items()}
        if inputs is not None:
            self._held |= {line: (inputs.fd, bit) for bit, line in enumerate(inputs.offsets)}
        self._ready: dict[Changes, bytearray] = {}
        #: What this kernel does to the outputs when a process dies; "" where it was not looked at.
        self.fact = ""

    def set(self, changes: Changes) -> None:
        """See `ports.Gpio`. Changes seen before cost one look-up and one ioctl."""
        values = self._ready.get(changes) or self._keep(changes)
        try:
            self._ioctl(self._output_fd, uapi.GPIO_V2_LINE_SET_VALUES, values)
        except OSError as error:
            raise BusError.of(error, self._chip, f"setting lines {changes}") from error

    @property
    def output_fd(self) -> int:
        """Of the outputs' request, to be inherited by a process that may set them too."""
        return self._output_fd

    def values_of(self, changes: Changes) -> bytes:
        """What the ioctl takes for these outputs. Raises: BusError."""
        return bytes(self._ready.get(changes) or self._keep(changes))

    def get(self, line: int) -> int:
        """See `ports.Gpio`."""
        if line not in self._held:
            raise BusError("invalid", self._chip, f"reading line {line}", "it was not requested")
        fd, bit = self._held[line]
        values = uapi.line_values([(bit, 0)])
        try:
            self._ioctl(fd, uapi.GPIO_V2_LINE_GET_VALUES, values)
        except OSError as error:
            raise BusError.of(error, self._chip, f"reading line {line}") from error
        return uapi.level_of(values, bit)

    def edges(self) -> tuple[Edge, ...]:
        """See `ports.Gpio`. Times are the kernel's CLOCK_MONOTONIC stamps."""
        if self._inputs is None:
            return ()
        found: list[Edge] = []
        try:
            # As many as the queue holds: a line that never rests must not hold the caller.
            while len(found) < _EDGES_KEPT and self._inputs.wait_edge_events(timeout=0):
                found.extend(map(_edge, self._inputs.read_edge_events()))
        except OSError as error:
            raise BusError.of(error, self._chip, "reading edges") from error
        return tuple(found)

    def close(self) -> None:
        """Release the lines; kernel and pulls then set the pins. Idempotent."""
        for held in (self._outputs, self._inputs):
            if held is not None:
                held.release()
        self._output_fd = -1
        self._held = {}

    def _keep(self, changes: Changes) -> bytearray:
        values = uapi.line_values((self._bit_of(line), level) for line, level in changes)
        if len(self._ready) >= _KEPT:
            del self._ready[next(iter(self._ready))]
        self._ready[changes] = values
        return values

    def _bit_of(self, line: int) -> int:
        if line not in self._output_bit:
            raise BusError(
                "invalid", self._chip, f"setting line {line}", "it was not requested as an output"
            )
        return self._output_bit[line]


def _edge(event: gpiod.EdgeEvent) -> Edge:
    value = int(event.event_type is gpiod.EdgeEvent.Type.RISING_EDGE)
    return Edge(line=event.line_offset, value=value, t_ns=event.timestamp_ns)


def find_chip(labels: Sequence[str]) -> Path:
    """The device of the chip with one of these labels: its number moves between kernels.

    Raises: BusError (absent: none has such a label; permission: one could not be asked).
    """
    closed: list[Path] = []
    seen: list[str] = []
    for path in sorted(DEVICES.glob("gpiochip*")):
        try:
            with gpiod.Chip(str(path)) as chip:
                seen.append(chip.get_info().label)
        except PermissionError:
            closed.append(path)
            continue
        except OSError:
            continue
        if seen[-1] in labels:
            return path
    if closed:
        raise BusError("permission", str(closed[0]), "opening")
    found = f"there are {', '.join(seen)}" if seen else "there is no GPIO chip at all"
    raise BusError("absent", " or ".join(labels), "looking for the GPIO chip", found)


def holders(chip: Path, lines: Sequence[int]) -> dict[int, str]:
    """Which of these lines are in use, and the name that their holder gave. Raises: BusError."""
    try:
        with gpiod.Chip(str(chip)) as opened:
            infos = [opened.get_line_info(line) for line in lines]
    except OSError as error:
        raise BusError.of(error, str(chip), "asking who holds the lines") from error
    return {info.offset: info.consumer for info in infos if info.used}


def open_gpio(chip: Path, setup: LineSetup) -> LinuxGpio:
    """Request all lines of `setup`; outputs get their levels with the request, in its order.

    Raises: BusError (busy: one of them is held; permission, invalid).
    """
    try:
        outputs = _request(chip, setup.consumer, output_settings(setup))
    except OSError as error:
        raise BusError.of(error, str(chip), "requesting the outputs") from error
    if not setup.inputs:
        return LinuxGpio(str(chip), outputs, None)
    try:
        inputs = _request(chip, setup.consumer, input_settings(setup.inputs))
    except OSError as error:
        outputs.release()
        raise BusError.of(error, str(chip), "requesting the inputs") from error
    return LinuxGpio(str(chip), outputs, inputs)


def keeps_driving(chip: Path, setup: LineSetup) -> bool:
    """Request the lines, release them, and check whether an output is still one.

    For a free line the kernel only reports its last use. It reads the pin itself when the line is
    requested, so the lines are requested once more, as they are.
    Raises: BusError.
    """
    open_gpio(chip, setup).close()
    as_they_are: Settings = {line: gpiod.LineSettings() for line, _ in setup.outputs}
    try:
        held = _request(chip, setup.consumer, as_they_are)
        try:
            with gpiod.Chip(str(chip)) as opened:
                infos = [opened.get_line_info(line) for line, _ in setup.outputs]
        finally:
            held.release()
    except OSError as error:
        raise BusError.of(error, str(chip), "looking at released lines") from error
    return any(info.direction is gpiod_line.Direction.OUTPUT for info in infos)


def levels_as_they_are(chip: Path, setup: LineSetup) -> dict[int, int]:
    """The levels of the outputs of `setup` while no process drives them, pulls unchanged.

    Raises: BusError.
    """
    as_they_are: Settings = {line: gpiod.LineSettings() for line, _ in setup.outputs}
    try:
        held = _request(chip, setup.consumer, as_they_are)
    except OSError as error:
        raise BusError.of(error, str(chip), "looking at released lines") from error
    lines = LinuxGpio(str(chip), held, None)
    try:
        return {line: lines.get(line) for line, _ in setup.outputs}
    finally:
        lines.close()


def _request(chip: Path, consumer: str, settings: Settings) -> gpiod.LineRequest:
    return gpiod.request_lines(
        str(chip), consumer=consumer, config=settings, event_buffer_size=_EDGES_KEPT
    )


def output_settings(setup: LineSetup) -> Settings:
    """The kernel sets initial levels in the order of the request, which is this order."""
    return {
        line: gpiod.LineSettings(
            direction=gpiod_line.Direction.OUTPUT,
            output_value=gpiod_line.Value.ACTIVE if level else gpiod_line.Value.INACTIVE,
        )
        for line, level in setup.outputs
    }


_BIAS: dict[Pull, gpiod_line.Bias] = {
    "up": gpiod_line.Bias.PULL_UP,
    "down": gpiod_line.Bias.PULL_DOWN,
    "none": gpiod_line.Bias.DISABLED,
}


def input_settings(inputs: Sequence[InputLine]) -> Settings:
    """Pull and edge detection of each input; edges are stamped with CLOCK_MONOTONIC."""
    return {
        line.line: gpiod.LineSettings(
            direction=gpiod_line.Direction.INPUT,
            bias=_BIAS[line.pull],
            edge_detection=gpiod_line.Edge.BOTH if line.edges else gpiod_line.Edge.NONE,
            event_clock=gpiod_line.Clock.MONOTONIC,
        )
        for line in inputs
    }
