"""What runs beside the engine, and ends or hangs: the stopper, and what reads the sensors.

Owns: these kinds of faults. Must not know: what notices them.
"""

from __future__ import annotations

from collections.abc import Iterator

from campaign.kind import BUSES, Kind
from campaign.subject import Subject
from etd_hal.boardfile import BoardFile


def of_helpers(board: BoardFile) -> Iterator[Kind]:
    """Either stays as it is: whether it has ended or hangs, the engine sees the same of it."""
    yield Kind("the stopper hangs", "there", BUSES, _stopper_hangs, stays=True, is_aside=True)
    if board.guards.rail_monitor != "absent":
        yield Kind("the sensors hang", "there", BUSES, _sensors_hang, stays=True, is_aside=True)


def _stopper_hangs(subject: Subject) -> None:
    assert subject.rig is not None
    subject.rig.stopper.is_looking = False


def _sensors_hang(subject: Subject) -> None:
    assert subject.rig is not None
    subject.rig.is_sensing = False
