"""The bodies that fake boards have: a fingertip that lives, one that only conducts, or nobody's.

Owns: the choice of their figures; the shipped calibrations of the fake suit the living one.
Must not know: buses, chips.

numpy is imported with the living one only: what needs no nerves works without.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from etd_body.electrode import OPEN_CONTACT, dry_fingertip
from etd_body.minimal import MinimalBody
from etd_hal.boardfile import BoardFile
from etd_hal.modelled_fingers import OWN, Finger

if TYPE_CHECKING:
    from etd_body.living import LivingBody

_SEED = 20_260


def fingertip_body(board: BoardFile, electrode_count: int) -> MinimalBody:
    """A dry fingertip, the same every time, behind this board's source; it feels nothing."""
    return MinimalBody(
        dry_fingertip(electrode_count, seed=_SEED),
        leak_ohm=board.source.leak_ohm,
        compliance_v=board.source.compliance_v,
    )


def untouched(board: BoardFile, electrode_count: int) -> MinimalBody:
    """An array on a bench, that nothing is connected to yet."""
    return MinimalBody(
        (OPEN_CONTACT,) * electrode_count,
        leak_ohm=board.source.leak_ohm,
        compliance_v=board.source.compliance_v,
    )


def living_fingertip(
    board: BoardFile, positions_mm: Sequence[tuple[float, float]], finger: Finger = OWN
) -> LivingBody:
    """The same finger every time, from the moment that it is laid on: it sweats, moves and feels.

    `positions_mm`: where each electrode is, as in the array's file.
    """
    from etd_body.kinds import BodyKind, living
    from etd_body.living import LivingBody
    from etd_body.states import BreathingBody

    body = BreathingBody if finger.is_breathing else LivingBody
    leak_ohm, compliance_v = board.source.leak_ohm, board.source.compliance_v
    if finger.kind is None:
        return body(positions_mm, leak_ohm=leak_ohm, compliance_v=compliance_v, seed=_SEED)
    return living(
        BodyKind(finger.kind),
        positions_mm,
        leak_ohm=leak_ohm,
        compliance_v=compliance_v,
        seed=finger.seed,
        body=body,
    )
