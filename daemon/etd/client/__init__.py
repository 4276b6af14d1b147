"""What an application imports: `from etd import Display`.

Owns: the public client, blocking and for asyncio. Must not know: the engine, the gateway, boards.
"""

from __future__ import annotations

from etd.client.aio import AsyncDisplay
from etd.client.display import Display
from etd.client.options import FrameOptions
from etd.client.presented import CutShort
from etd.client.telemetry import AsyncTelemetry, Telemetry

__all__ = ["AsyncDisplay", "AsyncTelemetry", "CutShort", "Display", "FrameOptions", "Telemetry"]
