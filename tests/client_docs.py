"""The page of the Python client, made from its signatures and docstrings.

Owns: the order and the form of `docs/client.md`. Must not know: what a method does.

`python tests/client_docs.py > docs/client.md` writes it anew.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from typing import Any

from etd import CutShort, DaemonGone, Display, Refused, WrongThread
from etd.client.array import ElectrodeArray
from etd.client.beside import Underway
from etd.client.connection import Connection
from etd.client.options import FrameOptions
from etd.client.patterns import PatternOptions
from etd.client.playing import Played
from etd.client.presented import Presented
from etd.client.telemetry import Telemetry

_HEAD = """\
# The Python client

Made from the docstrings by `python tests/client_docs.py`. The [examples](examples/README.md) show
how it is used, the [protocol](protocol.md) says what each request means, and
[install.md](install.md#from-another-computer) how a program on another computer gets there.

`AsyncDisplay` has the same methods, awaited; `begin` returns a task, `kept` is for `async with`,
and `async with` connects:

```python
import asyncio

from etd import AsyncDisplay


async def main():
    async with AsyncDisplay() as display:
        await display.arm(open_to=0.8)
        shown = await display.present({27: 0.8, 28: 0.8}, seconds=0.5)
        print(shown.first_at, shown.why_not or "as asked")


asyncio.run(main())
```
"""

#: (heading, the methods of a display).
_SECTIONS = (
    ("Facts", ("facts", "electrodes", "array", "status", "daemon_clock")),
    ("Lease and supply", ("arm", "kept", "keep", "disarm", "stop", "clear", "arm_holder", "close")),
    (
        "A stimulus, and what was fired",
        ("present", "present_current", "begin", "begin_current", "preview"),
    ),
    (
        "Frames",
        ("show", "show_current", "hold", "hold_current", "stream", "stream_current"),
    ),
    ("Patterns", ("play", "check_pattern")),
    ("Contact, what is felt, marks, reports", ("measure", "felt", "mark", "telemetry")),
    (
        "Records",
        (
            "record",
            "note",
            "start_record",
            "stop_record",
            "records",
            "fetch_record",
            "delete_record",
        ),
    ),
    (
        "Calibrations",
        (
            *("calibrations", "calibration"),
            *("check_may_store", "set_calibration", "delete_calibration"),
        ),
    ),
)


def page() -> str:
    return "\n".join(_lines()) + "\n"


def public(kind: type) -> set[str]:
    return {name for name in dir(kind) if not name.startswith("_")}


def _lines() -> Iterator[str]:
    yield _HEAD
    yield "## Display"
    yield from _entry("Display", Display.__init__, _text(Connection))
    for heading, names in _SECTIONS:
        yield f"## {heading}\n"
        for name in names:
            yield from _member(Display, name)
    yield "## Options of a frame\n"
    yield from _fields(FrameOptions, _text(FrameOptions))
    yield "## Options of a pattern\n"
    yield from _fields(PatternOptions, _text(PatternOptions))
    for kind in (Presented, Played, Underway, ElectrodeArray, Telemetry):
        yield f"## {kind.__name__}\n"
        yield f"{_text(kind)}\n"
        if kind in (Presented, Played):
            yield from _fields(kind, "")
        for name in _own(kind):
            yield from _member(kind, name)
    yield "## Errors\n"
    for error in (Refused, CutShort, DaemonGone, WrongThread):
        yield f"**`etd.{error.__name__}`**: {_text(error)}\n"


def _own(kind: type) -> list[str]:
    """Methods and properties, in the order of the source."""
    return [
        name
        for name, value in vars(kind).items()
        if not name.startswith("_") and (inspect.isfunction(value) or isinstance(value, property))
    ]


def _member(kind: type, name: str) -> Iterator[str]:
    value: Any = inspect.getattr_static(kind, name)
    if isinstance(value, property):
        returned = inspect.signature(value.fget).return_annotation  # type: ignore[arg-type]
        yield f"**`{name}: {_plain(returned)}`**\n"
        yield f"{_text(value)}\n"
    else:
        yield from _entry(name, value, _text(value))


def _entry(name: str, function: Any, text: str) -> Iterator[str]:
    signature = inspect.signature(function)
    given = [parameter for parameter in signature.parameters.values() if parameter.name != "self"]
    words = []
    for parameter in given:
        if _is_first_keyword(parameter, given):
            words.append("*")
        words.append(_parameter(parameter))
    listed = ", ".join(words)
    returned = _plain(signature.return_annotation)
    yield f"**`{name}({listed})`**" + ("" if returned == "None" else f" → `{returned}`") + "\n"
    yield f"{text}\n"


def _is_first_keyword(parameter: inspect.Parameter, given: list[inspect.Parameter]) -> bool:
    keywords = [each for each in given if each.kind is inspect.Parameter.KEYWORD_ONLY]
    has_star = any(each.kind is inspect.Parameter.VAR_POSITIONAL for each in given)
    return not has_star and bool(keywords) and parameter is keywords[0]


def _parameter(parameter: inspect.Parameter) -> str:
    if parameter.kind is inspect.Parameter.VAR_KEYWORD:
        return "**options"
    star = "*" if parameter.kind is inspect.Parameter.VAR_POSITIONAL else ""
    default = "" if parameter.default is inspect.Parameter.empty else f" = {parameter.default!r}"
    return f"{star}{parameter.name}: {_plain(parameter.annotation)}{default}"


def _fields(kind: type, text: str) -> Iterator[str]:
    if text:
        yield f"{text}\n"
    for name, annotation in kind.__annotations__.items():
        yield f"- `{name}: {_plain(annotation)}`"
    yield ""


def _plain(annotation: object) -> str:
    written = str(getattr(annotation, "__forward_arg__", annotation))
    return re.sub(r"\bUnpack\[(\w+)\]", r"\1", written)


def _text(documented: object) -> str:
    text = inspect.getdoc(documented)
    assert text, f"{documented} has no docstring"
    return text


if __name__ == "__main__":
    sys.stdout.write(page())
