"""The maxima of this board and site: the smallest of what code, board file and body-site file say.

Owns: the maxima, which no frame, no person's file and no test of a board passes, and how they
follow what the machine can time. Must not know: persons, time, hardware, what becomes of a request
for more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from etd.files.body_site import BodySite
from etd.pulse.request import SHORTEST_US
from etd_hal import ceilings
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
    net_charge_pc: int
    probe_current_ua: int
    probe_width_us: int
    #: No pulse is shorter than one word of the bus.
    min_width_us: int = SHORTEST_US


class MaximaInForce:
    """The maxima as this machine can keep them now; every component reads them here.

    Each timing calibration may change the widths that the guard lets pass, and nothing else. So the
    ledger and the soft start, which bound current, charge and time, may read their numbers once.
    """

    def __init__(self, declared: Maxima) -> None:
        self._declared = declared
        self.now = declared

    def follow(self, min_width_us: int, widest_us: int) -> bool:
        """After a timing calibration: the shortest pulse of this machine, and the widest that the
        guard lets pass in its worst case. Returns True if a maximum has changed.
        """
        before, declared = self.now, self._declared
        self.now = replace(
            declared,
            min_width_us=max(declared.min_width_us, min_width_us),
            width_us=min(declared.width_us, widest_us),
            probe_width_us=min(declared.probe_width_us, widest_us),
        )
        return self.now != before

    @property
    def limitations(self) -> tuple[str, ...]:
        """What this machine refuses although the files allow it, as sentences."""
        now, declared, found = self.now, self._declared, []
        if now.width_us < declared.width_us:
            found.append(
                f"pulses of more than {now.width_us} us are refused: on this machine their worst"
                " case is above what the guard lets pass"
            )
        if now.min_width_us > declared.min_width_us:
            found.append(
                f"pulses of less than {now.min_width_us} us are refused: on this machine one word"
                " takes as long"
            )
        return tuple(found)


def maxima_of(board: BoardFile, site: BodySite) -> Maxima:
    """The smallest of each bound among code, board file and body-site file."""
    most, here = board.maxima, site.maxima
    current_ua = min(ceilings.CURRENT_UA, most.current_ua, here.current_ua)
    width_us = min(ceilings.WIDTH_US, most.width_us, here.width_us)
    return Maxima(
        current_ua=current_ua,
        uncalibrated_current_ua=min(current_ua, here.uncalibrated_current_ua),
        width_us=width_us,
        charge_pc=min(ceilings.CHARGE_NC, most.charge_nc, here.charge_nc) * PC_PER_NC,
        rate_hz=min(ceilings.RATE_HZ, most.rate_hz, here.rate_hz),
        interval_us=max(ceilings.INTERVAL_US, here.interval_us),
        mean_current_ua=min(ceilings.MEAN_CURRENT_UA, most.mean_current_ua, here.mean_current_ua),
        array_mean_current_ua=min(
            ceilings.ARRAY_MEAN_CURRENT_UA,
            most.array_mean_current_ua,
            here.array_mean_current_ua,
        ),
        on_us_per_s=min(ceilings.ON_US_PER_S, here.on_us_per_s),
        array_on_us_per_s=min(ceilings.ARRAY_ON_US_PER_S, here.array_on_us_per_s),
        net_charge_pc=min(ceilings.NET_CHARGE_NC, here.net_charge_nc) * PC_PER_NC,
        probe_current_ua=min(ceilings.PROBE_CURRENT_UA, current_ua, most.probe_current_ua),
        probe_width_us=min(ceilings.PROBE_WIDTH_US, width_us, most.probe_width_us),
    )
