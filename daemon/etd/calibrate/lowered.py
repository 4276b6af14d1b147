"""A calibration without what was too strong since it was made.

Owns: which of its figures that leaves. Must not know: what was asked, where it is stored.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from etd.calibrate.progress import capped
from etd.protocol.calibration import Calibration


def lowered(made: Calibration, left_ua: Mapping[int, int]) -> Calibration:
    """`left_ua`: by electrode, the most that was left of its current. Where that is less than its
    cap, the cap is lower, and what was found of all levels together is of others.
    """
    lower_ua = {one: ua for one, ua in left_ua.items() if ua < made.electrode[one].cap_ua}
    if not lower_ua:
        return made
    each = list(made.electrode)
    for electrode, ua in lower_ua.items():
        each[electrode] = capped(each[electrode], ua, each[electrode].comfortable_ua)
    return msgspec.structs.replace(
        made, electrode=tuple(each), is_whole_accepted=None, adaptation=None
    )
