"""A calibration without what was too strong since it was made.

Owns: which of its figures that leaves. Must not know: what was asked, where it is stored.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from etd.calibrate.progress import capped
from etd.protocol.calibration import Calibration


def lowered(made: Calibration, left_ua: Mapping[int, tuple[int, int]]) -> Calibration:
    """`left_ua`: by electrode, the most that was left of its level and of its cap. No figure rises;
    where one falls, what was found of all levels together is of others.
    """
    each = list(made.electrode)
    for electrode, (level_ua, cap_ua) in left_ua.items():
        if electrode < len(each):
            was = each[electrode]
            least_ua = min(was.cap_ua, cap_ua), min(was.comfortable_ua, level_ua)
            each[electrode] = capped(was, *least_ua)
    if tuple(each) == made.electrode:
        return made
    return msgspec.structs.replace(
        made, electrode=tuple(each), is_whole_accepted=None, adaptation=None
    )
