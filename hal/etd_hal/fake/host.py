"""The machine that a fake board hangs on: in order, but for what is put in.

Owns: its figures. Must not know: the machine that the fake really runs on.
"""

from __future__ import annotations

from etd_hal.bench import Health
from etd_hal.fake.faults import Faults, MachineTrouble

_WARM_C = 52.0
_HOT_C = 84.5


class FakeHost:
    """See `bench.Host`."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults

    def packages(self) -> dict[str, str | None]:
        return {"gpiod": None} if self._has("package_missing") else {}

    def problem(self) -> str | None:
        if self._has("wrong_model"):
            return "this is a machine whose SPI cannot time a pulse: use a Raspberry Pi 4, 3 or 2 W"
        return None

    def facts(self) -> tuple[str, ...]:
        return ("model: none, this is the fake",)

    def health(self) -> Health:
        return Health(
            temperature_c=_HOT_C if self._has("hot") else _WARM_C,
            is_throttled=self._has("throttled"),
            is_under_voltage=self._has("under_voltage"),
        )

    def keeps_pins(self) -> bool:
        return self._has("pins_kept")

    def set_up_realtime(self, priority: int, core: int | None) -> tuple[str, ...]:  # noqa: ARG002
        """The fake's process stays an ordinary one."""
        if self._has("realtime_refused"):
            return ("real-time scheduling was not granted (Operation not permitted)",)
        return ()

    def _has(self, kind: str) -> bool:
        return any(trouble.kind == kind for trouble in self._faults.of(MachineTrouble))
