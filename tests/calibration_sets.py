"""Calibrations of a set, and planners for them: what tests of the set share.

Owns: making them, for sixteen electrodes of Kajimoto's board. Must not know: what a test expects.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from engine_parts import (
    TIMING,
    AnySelector,
    array,
    board_file,
    body_site,
    calibration,
    machine_file,
)
from etd.files.body_site import BodySite
from etd.planning.headroom import PlanRules
from etd.planning.plan import Planner
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.frame import Polarity
from etd.safety.limits import PersonLimits, limits_of_calibrations
from etd.safety.maxima import maxima_of
from etd_hal.cost import CostModel, FiledComputing

N = 16
MAXIMA = maxima_of(board_file(), body_site())


def made(polarity: Polarity, caps_ua: Sequence[int] = (3_000,) * N, **changes: Any) -> Calibration:
    """Threshold a third, comfortable two thirds of each cap."""
    electrode = tuple(
        ElectrodeLimits(threshold_ua=cap // 3, comfortable_ua=2 * cap // 3, cap_ua=cap)
        for cap in caps_ua
    )
    return calibration(polarity=polarity, electrode=electrode, **changes)


def person_of(*calibrations: Calibration) -> PersonLimits:
    return limits_of_calibrations(calibrations, MAXIMA, "grid-4x4", N, "fingertip")


def planner_of(*calibrations: Calibration, site: BodySite | None = None) -> Planner:
    """`site`: the fingertip, or one that differs from it in other things than its maxima."""
    site = site or body_site()
    rules = PlanRules(array(), site, MAXIMA, person_of(*calibrations), 10_000 / 4_095)
    cost = CostModel(board_file(), machine_file(), TIMING, FiledComputing(60.0))
    return Planner(AnySelector(), rules, cost)
