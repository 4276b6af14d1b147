"""`Display.show` over a Unix socket and over ssh on the loopback, until it is answered.

Owns: the two displays and their table. Must not know: how ssh is set up (`ssh_rig.py`).

On one machine there is no network in it: what ssh itself costs, at both its ends.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

from rich.table import Table

from command_rig import command_rig
from etd import Display
from etd.client import clock
from etd.files.paths import address_of
from ssh_rig import missing, ssh_rig

_FRAMES, _QUICK = 1_000, 50


@dataclass(frozen=True)
class OverSsh:
    """In us; empty `cannot` where it could be measured."""

    cannot: str
    here_us: tuple[float, float] = (0.0, 0.0)
    ssh_us: tuple[float, float] = (0.0, 0.0)
    #: Of the two clocks' offset, in the end.
    uncertainty_us: float = 0.0


def measure(is_quick: bool) -> OverSsh:
    why_not = missing()
    if why_not is not None:
        return OverSsh(why_not)
    with command_rig() as commands, ssh_rig(commands) as rig, commands.daemon():
        rig.admit()
        os.environ["PATH"] = rig.environment["PATH"]
        here = address_of(commands.folder / "run" / "etd" / "main")
        frames = _QUICK if is_quick else _FRAMES
        with Display(address=here) as near:
            here_us, _ = _shown(near, frames)
        with Display(host="display") as far:
            ssh_us, uncertainty_ns = _shown(far, frames)
    return OverSsh("", here_us, ssh_us, uncertainty_ns / 1_000)


def table(found: OverSsh) -> Table:
    made = Table(
        title=f"`show`, silent frames, until it is answered; {_FRAMES} each, measured here"
    )
    for column in ("over", "p50", "p99"):
        made.add_column(column, justify="left" if column == "over" else "right")
    if found.cannot:
        made.caption = f"not measured here: {found.cannot}"
        return made
    for over, spread_us in (("a Unix socket", found.here_us), ("ssh", found.ssh_us)):
        made.add_row(over, *(f"{value_us / 1_000:.2f} ms" for value_us in spread_us))
    made.caption = f"the clocks' offset was known within {found.uncertainty_us:.0f} us"
    return made


def _shown(display: Display, frames: int) -> tuple[tuple[float, float], int]:
    """p50 and p99 in us; within how much the clocks' offset is known."""
    display.arm()
    silent = [0.0] * display.electrodes
    took_us = []
    for _ in range(frames):
        begun_ns = clock.now_ns()
        display.show(silent)
        took_us.append((clock.now_ns() - begun_ns) / 1_000)
    took_us.sort()
    spread_us = took_us[len(took_us) // 2], took_us[len(took_us) * 99 // 100]
    return spread_us, display.present(silent, seconds=0.05).uncertainty_ns
