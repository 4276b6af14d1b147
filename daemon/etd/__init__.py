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
    from etd.client import CutShort as CutShort
    from etd.client import Display as Display
    from etd.files.pattern import Pattern as Pattern
    from etd.files.pattern import PatternFrame as PatternFrame

__all__ = [
    "AlreadyRunning",
    "AsyncDisplay",
    "CutShort",
    "DaemonGone",
    "Display",
    "EtdError",
    "FileError",
    "Pattern",
    "PatternError",
    "PatternFrame",
    "Refused",
    "WrongThread",
    "__version__",
]

_LAZY = {
    "AsyncDisplay": "etd.client",
    "CutShort": "etd.client",
    "Display": "etd.client",
    "Pattern": "etd.files.pattern",
    "PatternFrame": "etd.files.pattern",
}


def __getattr__(name: str) -> object:
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
