"""The engine's pure parts, put together from the shipped files for tests that change one thing.

Owns: builders with values that are easy to reckon with. Must not know: the fake, the engine's loop.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import msgspec

from etd.files.array import Array, load_array
from etd.files.body_site import BodySite, load_body_site
from etd.files.resources import find
from etd.planning.headroom import PlanRules
from etd.planning.plan import Planner
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import CannotSelect
from etd.protocol.frame import Frame
from etd.pulse.request import NO_GAIN, MaxGain
from etd.safety.limits import PersonLimits, limits_of_calibration
from etd.safety.maxima import Maxima, maxima_of
from etd_hal.boardfile import BoardFile, MachineFile, load_board, load_machine
from etd_hal.cost import CostModel, FiledComputing
from etd_hal.selection import Selection
from etd_hal.timing import Timing

#: What the fake's kernel takes for its messages, in us.
TIMING = Timing(word_us=15.83, delay_extra_us=0.3, message_us=9.1, spread_us=0.0)


def board_file(name: str = "kajimoto-hv507") -> BoardFile:
    return load_board(find("boards", name))


def machine_file(name: str = "pi4") -> MachineFile:
    return load_machine(find("machines", name))


def body_site(name: str = "fingertip") -> BodySite:
    return load_body_site(find("bodysites", name))


def array(name: str = "grid-4x4") -> Array:
    return load_array(find("arrays", name))


def site_with(**maxima: int) -> BodySite:
    """The fingertip with other maxima."""
    site = body_site()
    return msgspec.structs.replace(site, maxima=msgspec.structs.replace(site.maxima, **maxima))


def board_with(**maxima: int) -> BoardFile:
    """Kajimoto's board with other maxima."""
    board = board_file()
    return msgspec.structs.replace(board, maxima=msgspec.structs.replace(board.maxima, **maxima))


def maxima_with(**values: int) -> Maxima:
    """Those of Kajimoto's board on a fingertip, but for what is named."""
    maxima = maxima_of(board_file(), body_site())
    fields = {name: getattr(maxima, name) for name in Maxima.__slots__}
    return Maxima(**{**fields, **values})


def calibration(electrodes: int = 16, **changes: Any) -> Calibration:
    """Threshold 1000, comfortable 2000, cap 3000 uA everywhere."""
    limits = ElectrodeLimits(threshold_ua=1_000, comfortable_ua=2_000, cap_ua=3_000)
    made = Calibration(
        participant="P01",
        body_site="fingertip",
        array="grid-4x4",
        polarity="anodic",
        width_us=100,
        rate_hz=60.0,
        returns="all",
        date=datetime.date(2025, 1, 15),
        program="test",
        electrode=(limits,) * electrodes,
    )
    return msgspec.structs.replace(made, **changes)


class AnySelector:
    """Selects whatever is asked for, but for sets of returns when it `can_choose` none."""

    def __init__(self, outputs: int = 64, can_choose: bool = True) -> None:
        self._outputs = outputs
        self._can_choose = can_choose

    def selection(self, output: int, returns: tuple[int, ...] | None) -> Selection:
        everybody = (1 << self._outputs) - 1
        if returns is None:
            return Selection(output, everybody & ~(1 << output))
        if not self._can_choose:
            raise CannotSelect(output, "OPEN", "half-bridges")
        return Selection(output, sum(1 << electrode for electrode in returns))


def planner(
    *,
    caps_ua: Sequence[int] | None = None,
    calibrated: Calibration | None = None,
    board: BoardFile | None = None,
    site: BodySite | None = None,
    layout: Array | None = None,
    can_choose: bool = True,
    max_gain: MaxGain = NO_GAIN,
) -> Planner:
    """For a person with these caps; Kajimoto's board, 16 electrodes unless told otherwise."""
    board, site, layout = board or board_file(), site or body_site(), layout or array()
    maxima = maxima_of(board, site)
    if calibrated is not None:
        person = limits_of_calibration(calibrated, maxima, layout.name, layout.count, site.name)
    else:
        caps = tuple(caps_ua) if caps_ua is not None else (3_000,) * layout.count
        person = PersonLimits(caps, maxima.width_us, maxima.width_us, None)
    return Planner(
        AnySelector(can_choose=can_choose),
        PlanRules(layout, site, maxima, person, 10_000 / 4_095, max_gain),
        CostModel(board, machine_file(), TIMING, FiledComputing(60.0)),
    )


def frame(**fields: Any) -> Frame:
    return Frame(**{"lease": "a-lease", "seq": 0, **fields})


def currents(electrodes: int = 16, **only: int) -> tuple[int, ...]:
    """0 everywhere but at the named ones: currents(e3=1000)."""
    wanted = {int(name[1:]): value for name, value in only.items()}
    return tuple(wanted.get(electrode, 0) for electrode in range(electrodes))
