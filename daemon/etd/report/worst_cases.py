"""What each guard lets through if the current source stays on: docs/hardware.md's table as data.

Owns: these rows; a test holds the document to them. Must not know: configurations.
"""

from __future__ import annotations

from typing import Final, NamedTuple


class GuardRow(NamedTuple):
    """`guard`: its key in the board file; "" for what is in every daemon or in no file. `acts_s`:
    within so long, and before that every guard above it has failed; None: never.
    """

    guard: str
    what: str
    acts_s: float | None


ROWS: Final = (
    GuardRow("one_shot", "the source is on for at most 250 us, then off for 100 us", 250e-6),
    GuardRow("", "the stopper: blanks when a message is 1 ms overdue", 1e-3),
    GuardRow("heartbeat", "no edge within 20 ms takes the supply away", 20e-3),
    GuardRow("", "the stopper after the engine was killed", 20e-3),
    GuardRow("", "`etd safe` after the engine died", 1.0),
    GuardRow("", "systemd's watchdog (0.5 s), then `etd safe`", 1.5),
    GuardRow("", "the processor's watchdog, then a boot, where it is switched on", 15.0),
    GuardRow("", "none of them: for each second that the supply lasts", 1.0),
)


def charge_uc(row: GuardRow, full_scale_ua: int) -> float:
    """At the source's full scale, until the guard acts."""
    return full_scale_ua * (row.acts_s or 0.0)
