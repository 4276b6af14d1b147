"""The Python that the daemon needs; the client runs on one that is older.

Owns: which one, and the refusal below it. Must not know: what is refused.
"""

from __future__ import annotations

import sys

from etd_hal.errors import PythonTooOld

#: `tomllib`, and what else of 3.11 the daemon's modules use (docs/decisions/0065).
OLDEST = (3, 11)


def is_old() -> bool:
    return sys.version_info < OLDEST


def check_python(what: str) -> None:
    """`what` is the subject of the refusal, a part of the daemon. Raises: PythonTooOld."""
    if is_old():
        raise too_old(what)


def too_old(what: str) -> PythonTooOld:
    return PythonTooOld(what, _told(OLDEST), _told(sys.version_info[:2]))


def _told(version: tuple[int, ...]) -> str:
    return ".".join(map(str, version))
