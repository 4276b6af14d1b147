"""A person's exponent: how far the threshold follows the resistance of the skin, and how well that
is known.

Owns: the type, and when it can be used. Must not know: how it is measured, what a law makes of it,
calibrations.
"""

from __future__ import annotations

import datetime
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.protocol.errors import Refused
from etd.protocol.frame import PerElectrode

#: The part of the variation within electrodes that a usable fit explains, at least.
LEAST_EXPLAINED = 0.5
#: What no published slope comes near (docs/body.md has 0.7 to 1.3).
MOST_K = 2.0

K = Annotated[float, Meta(ge=-5.0, le=5.0)]


class FittedExponent(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """k of threshold ~ R^-k, within electrodes, over several states of the skin.

    `low` to `high`: the 95 % interval. `explained`: 0 to 1, of the variation of thresholds within
    electrodes. `fold`: by how much the states have changed the resistance, the median over
    electrodes of the largest by the smallest.
    """

    k: K
    low: K
    high: K
    explained: Annotated[float, Meta(ge=0.0, le=1.0)]
    electrodes: Annotated[tuple[Annotated[int, Meta(ge=0)], ...], PerElectrode]
    states: Annotated[int, Meta(ge=4, le=20)]
    fold: Annotated[float, Meta(ge=1.0)]
    date: datetime.date

    @property
    def why_not(self) -> str | None:
        """Why a law must not go by it; None if it may."""
        if not self.low <= self.k <= self.high:
            return (
                f"k = {self.k:.2f} lies outside of its interval, {self.low:.2f} to {self.high:.2f}"
            )
        if abs(self.k) > MOST_K:
            return f"k = {self.k:.2f} is not believed: none above {MOST_K:g} is known"
        if self.low <= 0.0 <= self.high:
            return (
                f"k = {self.k:.2f}, and its interval, {self.low:.2f} to {self.high:.2f}, has zero"
                " in it: thresholds may not follow the resistance at all"
            )
        if self.explained < LEAST_EXPLAINED:
            return (
                f"k = {self.k:.2f} explains {self.explained:.0%} of what thresholds did, less than"
                f" {LEAST_EXPLAINED:.0%}"
            )
        return None


def usable_k(fitted: FittedExponent | None) -> float | None:
    """k, where it may be used."""
    return None if fitted is None or fitted.why_not is not None else fitted.k


def check_exponent(fitted: FittedExponent | None) -> None:
    """For a body site with `power_law`, which goes by the person's k and has none of its own.

    Raises: Refused (`bad_calibration`).
    """
    if fitted is None:
        raise Refused(
            "bad_calibration",
            "the body site's power_law goes by an exponent of the person's, and none was measured:"
            " open with a calibration that has one (etd calibrate CODE --fit), or take power_law"
            " out of the body site",
        )
    if fitted.why_not is not None:
        raise Refused("bad_calibration", f"power_law is not for this person: {fitted.why_not}")
