"""What an application imports: `from etd import Display`.

Owns: the public client, blocking and for asyncio. Each name is loaded when it is first asked for:
asyncio alone is a third of the start of a program that has no use for it, and `etd stop` needs none
of them. Must not know: the engine, the gateway, boards.
"""

from __future__ import annotations

import importlib

#: Not `typing`'s, whose import takes time.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from etd.client.aio import AsyncDisplay as AsyncDisplay
    from etd.client.aio_telemetry import AsyncTelemetry as AsyncTelemetry
    from etd.client.display import Display as Display
    from etd.client.options import FrameOptions as FrameOptions
    from etd.client.presented import CutShort as CutShort
    from etd.client.telemetry import Telemetry as Telemetry

__all__ = ["AsyncDisplay", "AsyncTelemetry", "CutShort", "Display", "FrameOptions", "Telemetry"]

_LAZY = {
    "AsyncDisplay": "etd.client.aio",
    "AsyncTelemetry": "etd.client.aio_telemetry",
    "CutShort": "etd.client.presented",
    "Display": "etd.client.display",
    "FrameOptions": "etd.client.options",
    "Telemetry": "etd.client.telemetry",
}


def __getattr__(name: str) -> object:
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
