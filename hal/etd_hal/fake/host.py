"""The machine that a fake board hangs on: in order, but for what is put in.

Owns: its figures. Must not know: the machine that the fake really runs on.
"""

from __future__ import annotations

import datetime

from etd_hal.bench import UNKNOWN_CORE, CpuClock, Health, Obtained, ScanCore, Timekeeping
from etd_hal.fake.faults import MachineTrouble
from etd_hal.fake.faults_due import Faults

_WARM_C = 52.0
_HOT_C = 84.5
#: Of a process of its own size; the kernel's own pages in it are never locked.
_MAPPED_KB, _KERNELS_OWN_KB = 40_000, 32
_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
_INSTALLED = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
_TODAY = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)


class FakeHost:
    """See `bench.Host`."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._priority = 0
        self._cores: tuple[int, ...] = ()
        #: What the modelled kernel says of the scan's core: nothing, unless it is put in.
        self.modelled_core = UNKNOWN_CORE

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
            was_throttled=self._has("was_throttled") or self._has("throttled"),
            was_under_voltage=self._has("was_under_voltage") or self._has("under_voltage"),
        )

    def cpu_clock(self) -> CpuClock:
        if self._has("clock_follows_load"):
            return CpuClock("ondemand", 600_000, 1_800_000, 1_000_000)
        return CpuClock("performance", 600_000, 1_800_000, 1_800_000)

    def free_memory_kb(self) -> int:
        return 20_000 if self._has("little_memory") else 400_000

    def timekeeping(self) -> Timekeeping:
        return Timekeeping(
            source="the fake's own",
            resolution_ns=4_000_000 if self._has("clock_coarse") else 1,
            least_step_ns=-1_000 if self._has("clock_back") else 52,
            now=_EPOCH if self._has("date_wrong") else _TODAY,
            not_before=_INSTALLED,
            is_synchronized=not self._has("date_wrong"),
        )

    def keeps_pins(self) -> bool:
        return self._has("pins_kept")

    def set_up_realtime(self, priority: int, core: int | None) -> tuple[str, ...]:
        """The fake's process stays an ordinary one."""
        self._priority = priority
        self._cores = tuple(range(4)) if core is None else (core,)
        if self._has("realtime_refused"):
            return ("real-time scheduling was not granted (Operation not permitted)",)
        return ()

    def obtained(self) -> Obtained:
        return Obtained(
            policy="SCHED_OTHER" if self._has("not_scheduled") else "SCHED_FIFO",
            priority=self._priority,
            cores=self._cores,
            locked_kb=self._locked_kb(),
            mapped_kb=_MAPPED_KB,
            timer_slack_ns=1,
        )

    def scan_core(self) -> ScanCore:
        return self.modelled_core

    def _locked_kb(self) -> int:
        if self._has("not_locked"):
            return 0
        return _MAPPED_KB // 2 if self._has("partly_locked") else _MAPPED_KB - _KERNELS_OWN_KB

    def _has(self, kind: str) -> bool:
        return any(trouble.kind == kind for trouble in self._faults.of(MachineTrouble))
