"""`from etd import Display`: what an application needs, and the errors it may meet.

Owns: the public names, each loaded when it is first asked for, so that the engine can be imported
without ZeroMQ, and the command's entry point without anything. Must not know: anything else.
"""

from __future__ import annotations

import importlib

from etd.version import __version__

#: Not `typing`'s, whose import takes longer than all else here.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from etd.client import AsyncDisplay as AsyncDisplay
    from etd.client import CutShort as CutShort
    from etd.client import Display as Display
    from etd.files.pattern import Pattern as Pattern
    from etd.files.pattern import PatternFrame as PatternFrame
    from etd.protocol.errors import AlreadyRunning as AlreadyRunning
    from etd.protocol.errors import DaemonGone as DaemonGone
    from etd.protocol.errors import EtdError as EtdError
    from etd.protocol.errors import FileError as FileError
    from etd.protocol.errors import PatternError as PatternError
    from etd.protocol.errors import Refused as Refused
    from etd.protocol.errors import WrongThread as WrongThread

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

_ERRORS = (
    "AlreadyRunning",
    "DaemonGone",
    "EtdError",
    "FileError",
    "PatternError",
    "Refused",
    "WrongThread",
)
_LAZY = {
    "AsyncDisplay": "etd.client",
    "CutShort": "etd.client",
    "Display": "etd.client",
    "Pattern": "etd.files.pattern",
    "PatternFrame": "etd.files.pattern",
    **dict.fromkeys(_ERRORS, "etd.protocol.errors"),
}


def __getattr__(name: str) -> object:
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
