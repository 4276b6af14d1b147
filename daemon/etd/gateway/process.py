"""The gateway as a process: runs until a signal ends it.

Owns: signals. Must not know: what a turn does.
"""

from __future__ import annotations

import gc
import signal
from collections.abc import Callable
from types import FrameType

from etd.gateway.config import GatewayConfig
from etd.gateway.server import Gateway
from etd_hal.ports import Clock

_ENDINGS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def run_gateway(config: GatewayConfig, clock: Clock, on_ready: Callable[[], None]) -> int:
    """Serve until SIGTERM, SIGINT or SIGHUP; returns the exit status 0. Main thread only.

    `on_ready` is called once the sockets are bound. Raises: AlreadyRunning, FileError, before
    anything is served.
    """
    gateway = Gateway(config, clock)

    def note(_number: int, _frame: FrameType | None) -> None:
        gateway.is_asked_to_end = True

    before = {ending: signal.signal(ending, note) for ending in _ENDINGS}
    try:
        _keep_out_of_collections()
        on_ready()
        while not gateway.is_asked_to_end:
            gateway.step()
    finally:
        gateway.close()
        for ending, handler in before.items():
            signal.signal(ending, handler)
    return 0


def _keep_out_of_collections() -> None:
    """What is there now stays to the end. A full collection would step through all of it, 10 ms and
    more in the middle of a turn.
    """
    gc.collect()
    gc.freeze()
