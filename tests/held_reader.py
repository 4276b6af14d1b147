"""A reader of calibrations that has an answer when a test gives it one.

Owns: what it was asked for. Must not know: files, what is tested.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.peer import Peer


class HeldReader:
    """Reads what it is asked for when a test says so."""

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.found: Calibration | Refused | None = None
        self.cancelled = 0

    def begin(self, names: Sequence[str], gateway: Peer | None) -> None:
        assert gateway is None
        self.begun += names

    def result(self) -> tuple[Calibration, ...] | None:
        found, self.found = self.found, None
        if isinstance(found, Refused):
            raise found
        return None if found is None else (found,)

    def cancel(self) -> None:
        self.cancelled += 1
