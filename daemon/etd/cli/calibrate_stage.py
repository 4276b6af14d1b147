"""The stimulator that a calibration's command presents by, with the reports that it goes by.

Owns: which reports those are. Must not know: arming, what is asked, who answers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from etd.calibrate.conditions import Conditions
from etd.calibrate.stimulator import Stimulator
from etd.client import Display, clock


@contextmanager
def stimulator_on(
    display: Display,
    conditions: Conditions,
    wants_stop: Callable[[], bool],
    on_report: Callable[[object], None] = lambda _: None,
) -> Iterator[Stimulator]:
    """Of an armed display; not opened yet. Raises: Refused, DaemonGone."""
    with display.telemetry("scan", "halt", "modelled", "state") as reports:
        yield Stimulator(display, reports, clock.ClientClock(), conditions, wants_stop, on_report)
