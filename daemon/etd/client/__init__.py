"""What an application imports: `from etd import Display`.

Owns: the public client, blocking and for asyncio; the latter is loaded when it is first asked for,
since asyncio alone is a third of the start of a program that has no use for it. Must not know: the
engine, the gateway, boards.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from etd.client.display import Display
from etd.client.options import FrameOptions
from etd.client.presented import CutShort
from etd.client.telemetry import Telemetry

if TYPE_CHECKING:
    from etd.client.aio import AsyncDisplay as AsyncDisplay
    from etd.client.aio_telemetry import AsyncTelemetry as AsyncTelemetry

__all__ = ["AsyncDisplay", "AsyncTelemetry", "CutShort", "Display", "FrameOptions", "Telemetry"]

_LAZY = {"AsyncDisplay": "etd.client.aio", "AsyncTelemetry": "etd.client.aio_telemetry"}


def __getattr__(name: str) -> object:
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
