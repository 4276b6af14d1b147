"""The body that a fake board has unless told otherwise: one dry fingertip, all in contact.

Owns: the choice of its figures; the shipped calibrations of the fake suit it.
Must not know: buses, chips.
"""

from __future__ import annotations

from etd_body.electrode import dry_fingertip
from etd_body.minimal import MinimalBody
from etd_hal.boardfile import BoardFile

_SEED = 20_260


def fingertip_body(board: BoardFile, electrode_count: int) -> MinimalBody:
    """The same fingertip every time, behind this board's source."""
    return MinimalBody(
        dry_fingertip(electrode_count, seed=_SEED),
        leak_ohm=board.source.leak_ohm,
        compliance_v=board.source.compliance_v,
    )
