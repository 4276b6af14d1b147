"""`from etd import Display`: what an application needs, and the errors it may meet.

Owns: the public names, each loaded when it is first asked for, so that the engine can be imported
without ZeroMQ. Must not know: anything else.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from etd.protocol.errors import (
    AlreadyRunning,
    DaemonGone,
    EtdError,
    FileError,
    PatternError,
    Refused,
    WrongThread,
)
from etd.version import __version__

if TYPE_CHECKING:
    from etd.client import AsyncDisplay as AsyncDisplay
    from etd.client import Display as Display

__all__ = [
    "AlreadyRunning",
    "AsyncDisplay",
    "DaemonGone",
    "Display",
    "EtdError",
    "FileError",
    "PatternError",
    "Refused",
    "WrongThread",
    "__version__",
]

_LAZY = ("AsyncDisplay", "Display")


def __getattr__(name: str) -> object:
    if name in _LAZY:
        return getattr(importlib.import_module("etd.client"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
