"""Records by their requests to a gateway.

Owns: asking for one, and its lines as they are answered. Must not know: what is tested.
"""

from __future__ import annotations

import base64
import json
from typing import Any

from gateway_rig import GatewayRig


def record(rig: GatewayRig, do: str, name: str | None = None, **more: Any) -> dict[str, Any]:
    request = {"op": "record", "do": do, **more}
    return rig.call(**request if name is None else {**request, "name": name})


def written(rig: GatewayRig, name: str) -> list[dict[str, Any]]:
    """The lines, as `get` answers them piece by piece."""
    data = b""
    while piece := base64.b64decode(record(rig, "get", name, offset=len(data))["data"]):
        data += piece
    assert data == (rig.state_dir / "records" / f"{name}.jsonl").read_bytes()
    return [json.loads(line) for line in data.splitlines()]


def written_bytes(rig: GatewayRig, name: str) -> bytes:
    return (rig.state_dir / "records" / f"{name}.jsonl").read_bytes()


def ended(rig: GatewayRig, name: str) -> list[dict[str, Any]]:
    assert record(rig, "stop")["ok"]
    return written(rig, name)
