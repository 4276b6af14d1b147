"""The reader of calibrations without its process, for rigs whose time is stepped.

Owns: that it reads by the very code that the process has. Must not know: what is tested. The
process itself is tested in `tests/daemon/test_calibration_process.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from etd.files.calibration_reading import Asked, Found, answer_to
from etd.gateway.config import GatewayConfig
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.peer import Peer


class ReadInPlace:
    """See `etd.files.calibration_process.CalibrationReader`."""

    def __init__(self, folder: Path, shipped: Path | None = None) -> None:
        self._folder, self._shipped = folder, shipped
        self._found = Found()

    def begin(self, names: Sequence[str], gateway: Peer | None) -> None:
        shipped = None if self._shipped is None else str(self._shipped)
        asked = Asked(
            names=tuple(names), folder=str(self._folder), shipped=shipped, gateway=gateway
        )
        self._found = msgspec.msgpack.decode(answer_to(asked, lambda: None), type=Found)

    def result(self) -> tuple[Calibration, ...]:
        if self._found.error is not None:
            raise Refused(self._found.error, self._found.reason)
        return self._found.calibrations

    def cancel(self) -> None:
        pass


def read_in_place(config: GatewayConfig) -> ReadInPlace:
    """As a gateway of this configuration reads."""
    folder = config.calibrations or config.state_dir / "calibrations"
    return ReadInPlace(folder, config.shipped_calibrations)
