"""The published schema of the protocol, made from the structs that the daemon decodes into.

Owns: the shape of `docs/protocol.schema.json` (JSON Schema 2020-12). Must not know: sockets.

`python tests/protocol_schema.py > docs/protocol.schema.json` writes it anew.
"""

from __future__ import annotations

import inspect
import sys
from typing import Any, get_args

import msgspec

from etd.protocol.errors import ErrorCode
from etd.protocol.messages import (
    MAX_MESSAGE_BYTES,
    REPLY_OF_OP,
    TELEMETRY_OF_TOPIC,
    VERSION,
    Failure,
    Request,
)

_REF = "#/$defs/{name}"


def make_schema() -> dict[str, Any]:
    """Requests, the reply to each op, failures, and the body of each telemetry topic."""
    replies = list(dict.fromkeys(REPLY_OF_OP.values()))
    bodies = list(TELEMETRY_OF_TOPIC.values())
    types = [Request, Failure, *replies, *bodies]
    made, components = msgspec.json.schema_components(types, ref_template=_REF)
    reference = dict(zip([str(entry) for entry in types], made, strict=True))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "etd wire protocol",
        "version": VERSION,
        "max_message_bytes": MAX_MESSAGE_BYTES,
        "error_codes": sorted(get_args(ErrorCode)),
        "request": made[0],
        "failure": made[1],
        "replies": {op: reference[str(kind)] for op, kind in REPLY_OF_OP.items()},
        "telemetry": {topic: reference[str(kind)] for topic, kind in TELEMETRY_OF_TOPIC.items()},
        "$defs": {name: _described(made) for name, made in sorted(components.items())},
    }


def _described(made: dict[str, Any]) -> dict[str, Any]:
    """A docstring without its indentation, whether the library leaves that or not."""
    if "description" not in made:
        return made
    return {**made, "description": inspect.cleandoc(made["description"])}


def schema_text() -> str:
    """The file's content."""
    encoded = msgspec.json.encode(make_schema(), order="deterministic")
    return msgspec.json.format(encoded, indent=2).decode() + "\n"


if __name__ == "__main__":
    sys.stdout.write(schema_text())
