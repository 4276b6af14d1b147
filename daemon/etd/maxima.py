"""What nobody may get here: the smallest of what code, board file and body-site file say.

Owns: the maxima, which no frame, no person's file and no test of a board passes. Must not know:
persons, time, hardware, what becomes of a wish for more.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd import bodysite
from etd.bodysite import BodySite
from etd_hal.boardfile import BoardFile

#: uA x us = pC: charge is an integer throughout.
PC_PER_NC = 1_000


@dataclass(frozen=True, slots=True)
class Maxima:
    """The smallest of the ceilings in the code, the board's and the body site's."""

    current_ua: int
    uncalibrated_current_ua: int
    width_us: int
    charge_pc: int
    rate_hz: int
    interval_us: int
    mean_current_ua: int
    array_mean_current_ua: int
    on_us_per_s: int
    array_on_us_per_s: int
    probe_current_ua: int
    probe_width_us: int


def maxima_of(board: BoardFile, site: BodySite) -> Maxima:
    """What neither a person's file nor a frame can pass."""
    most, here = board.maxima, site.maxima
    current_ua = min(bodysite.MAX_CURRENT_UA, most.current_ua, here.current_ua)
    width_us = min(bodysite.MAX_WIDTH_US, most.width_us, here.width_us)
    return Maxima(
        current_ua=current_ua,
        uncalibrated_current_ua=min(current_ua, here.uncalibrated_current_ua),
        width_us=width_us,
        charge_pc=min(bodysite.MAX_CHARGE_NC, most.charge_nc, here.charge_nc) * PC_PER_NC,
        rate_hz=min(bodysite.MAX_RATE_HZ, most.rate_hz, here.rate_hz),
        interval_us=max(bodysite.MIN_INTERVAL_US, here.interval_us),
        mean_current_ua=min(
            bodysite.MAX_MEAN_CURRENT_UA, most.mean_current_ua, here.mean_current_ua
        ),
        array_mean_current_ua=min(
            bodysite.MAX_ARRAY_MEAN_CURRENT_UA,
            most.array_mean_current_ua,
            here.array_mean_current_ua,
        ),
        on_us_per_s=min(bodysite.MAX_ON_US_PER_S, here.on_us_per_s),
        array_on_us_per_s=min(bodysite.MAX_ARRAY_ON_US_PER_S, here.array_on_us_per_s),
        probe_current_ua=min(current_ua, most.probe_current_ua),
        probe_width_us=min(width_us, most.probe_width_us),
    )
