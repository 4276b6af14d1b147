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
from etd.protocol.frame import PerElectrode, ShortText

#: The part of the variation within electrodes that a usable fit explains, at least.
LEAST_EXPLAINED = 0.5
#: What no published slope comes near (docs/body.md has 0.7 to 1.3).
MOST_K = 2.0
#: From fewer electrodes, or from states that were more alike, no k is known.
LEAST_ELECTRODES, LEAST_FOLD = 4, 2.0
#: A wider interval says nothing of k.
MOST_SAID = 100.0

Said = Annotated[float, Meta(ge=-MOST_SAID, le=MOST_SAID)]


class FittedExponent(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """k of threshold ~ R^-k, within electrodes, over several states of the skin.

    `low` to `high`: the 95 % interval. `explained`: 0 to 1, of the variation of thresholds within
    electrodes. `fold`: by how much the states have changed the resistance, the median over
    electrodes of the largest by the smallest. `board`, `leak_ohm`: what it was measured with, since
    a leak takes more of a current where the skin resists more. None in a file of before they were
    kept.
    """

    k: Said
    low: Said
    high: Said
    explained: Annotated[float, Meta(ge=0.0, le=1.0)]
    electrodes: Annotated[tuple[Annotated[int, Meta(ge=0)], ...], PerElectrode]
    states: Annotated[int, Meta(ge=4, le=20)]
    fold: Annotated[float, Meta(ge=1.0, le=1e6)]
    date: datetime.date
    board: ShortText | None = None
    leak_ohm: Annotated[int, Meta(ge=1)] | None = None

    @property
    def why_not(self) -> str | None:
        """Why a law must not go by it, on whatever board; None if it may."""
        if not self.low <= self.k <= self.high:
            return (
                f"k = {self.k:.2f} lies outside of its interval, {self.low:.2f} to {self.high:.2f}"
            )
        if len(set(self.electrodes)) < LEAST_ELECTRODES:
            return (
                f"k = {self.k:.2f} is of {len(set(self.electrodes))} electrodes, and at least"
                f" {LEAST_ELECTRODES} are needed"
            )
        if self.fold < LEAST_FOLD:
            return (
                f"k = {self.k:.2f} is of a skin whose resistance changed {self.fold:.1f}-fold, and"
                f" {LEAST_FOLD:g}-fold is needed"
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
        if self.board is None or self.leak_ohm is None:
            return (
                f"k = {self.k:.2f} was measured before its board was kept with it, and a board's"
                " leak has a part in it: measure it again (etd calibrate CODE --fit)"
            )
        return None

    def why_not_on(self, board: str, leak_ohm: int) -> str | None:
        """The same on this board."""
        if (why := self.why_not) is not None or (self.board, self.leak_ohm) == (board, leak_ohm):
            return why
        return (
            f"k = {self.k:.2f} was measured with {self.board} and its leak of {self.leak_ohm} ohm,"
            f" this is {board} with {leak_ohm} ohm, and a board's leak has a part in k: measure it"
            " again on this one (etd calibrate CODE --fit)"
        )


def usable_k(fitted: FittedExponent | None, board: str, leak_ohm: int) -> float | None:
    """k, where it may be used on this board."""
    if fitted is None or fitted.why_not_on(board, leak_ohm) is not None:
        return None
    return fitted.k


def check_exponent(fitted: FittedExponent | None, board: str, leak_ohm: int) -> None:
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
    if (why := fitted.why_not_on(board, leak_ohm)) is not None:
        raise Refused("bad_calibration", f"power_law is not for this person: {why}")
