"""A machine file from a bench: what was found on this machine, within what the guard assumes.

Owns: which figure becomes which key, and with what margin. Must not know: how anything is measured.

The guard's own worst case and the bounds at which the engine halts are never taken from a bench: a
machine that is slow must not make the guard more lenient. They stay as in the file that the bench
was compared with.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from etd.bench.computing import visit_us
from etd.bench.messages import Messages
from etd.bench.result import Result
from etd.protocol.errors import FileError
from etd_hal.boardfile import Bounds, MachineFile

#: What a calibration on the same machine may find another time.
_MARGIN = 0.15
#: The same for small figures, in us: the clock's resolution and noise.
_LEAST_MARGIN_US = 0.3


def measured_machine(machine: MachineFile, result: Result) -> MachineFile:
    """`machine` with what was found instead. Raises: FileError, where the guard's worst case would
    be passed.
    """
    computing_us = round(visit_us(result.computing), 1)
    measured = msgspec.structs.replace(machine, name="measured", visit_us=computing_us)
    if result.messages is None:
        return measured
    return _with_messages(measured, result.messages)


def _with_messages(machine: MachineFile, found: Messages) -> MachineFile:
    bounds = {
        "word_us": _around(found.word_us),
        "delay_extra_us": _around(found.delay_extra_us),
        "message_us": _around(found.message_us),
    }
    for key, worst_us in (
        ("word_us", machine.guard_word_us),
        ("delay_extra_us", machine.guard_delay_extra_us),
    ):
        if bounds[key].high > worst_us:
            raise FileError(
                "bench",
                key,
                f"{bounds[key].high} is above the guard's worst case of {worst_us} us",
                "check SPI clock and governor; if an oscilloscope shows the same, write a machine"
                f" file by hand, with guard_{key} from the oscilloscope",
            )
    return msgspec.structs.replace(machine, gpio_call_us=round(found.gpio_call_us, 2), **bounds)


def _around(found_us: float) -> Bounds:
    margin_us = max(_LEAST_MARGIN_US, _MARGIN * found_us)
    return Bounds(low=round(max(0.0, found_us - margin_us), 2), high=round(found_us + margin_us, 2))


def toml_of(machine: MachineFile, result: Result) -> str:
    return "\n".join(_lines_of(machine, result)) + "\n"


def _lines_of(machine: MachineFile, result: Result) -> Iterator[str]:
    yield f"# Measured by etd bench {result.etd} on {result.date}, from {result.machine}."
    yield from (f"# {fact}" for fact in result.facts)
    if result.messages is None:
        yield "# Only visit_us is measured: no board was there."
    for key, value in msgspec.to_builtins(machine).items():
        yield f"{key} = {_value(value)}"


def _value(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(each)}" for key, each in value.items()) + " }"
    # A JSON string, number or list of strings is one of TOML, too.
    return msgspec.json.encode(value).decode()
