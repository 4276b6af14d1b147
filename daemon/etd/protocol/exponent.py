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

#: The part of what thresholds did within electrodes that a usable fit explains, at least: of what
#: a line over time leaves of it, and of all.
LEAST_EXPLAINED = 0.5
#: What no published slope comes near (docs/body.md has 0.7 to 1.3).
MOST_K = 2.0
#: What a board's leak does by itself to a k lies between -0.3 and zero, where it is measured: a k
#: that is no larger than that is not known to be of the skin (docs/decisions/0069).
LEAST_K = 0.3
#: From fewer electrodes, or from states that were more alike, no k is known.
LEAST_ELECTRODES, LEAST_FOLD = 4, 2.0
#: A wider interval says nothing of k.
MOST_SAID = 100.0
#: An interval that ends further from k than this many times k says as little of it as zero.
_MOST_OFF = 1.0
#: Midnight comes at another time elsewhere.
_AHEAD = datetime.timedelta(days=1)

Part = Annotated[float, Meta(ge=0.0, le=1.0)]
Said = Annotated[float, Meta(ge=-MOST_SAID, le=MOST_SAID)]


class FittedExponent(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """k of threshold ~ R^-k, within electrodes, over several states of the skin.

    `low` to `high`: the 90 % interval. `explained_of_all`: 0 to 1, of what thresholds did within
    electrodes, what they did with time included; `explained`: of what a straight line over time
    leaves of that. `fold`: by how much the states have changed the resistance, the median over
    electrodes of the largest by the smallest. `catch_trials`, `false_alarm_rate`: silent trials in
    all states, and the part of them that was said to be felt. `board`, `leak_ohm`: what it was
    measured with, since a leak takes more of a current where the skin resists more. What is None
    stands in a file of before it was kept.
    """

    k: Said
    low: Said
    high: Said
    explained: Part
    explained_of_all: Part | None = None
    electrodes: Annotated[tuple[Annotated[int, Meta(ge=0)], ...], PerElectrode]
    states: Annotated[int, Meta(ge=4, le=20)]
    fold: Annotated[float, Meta(ge=1.0, le=1e6)]
    date: datetime.date
    catch_trials: Annotated[int, Meta(ge=1)] | None = None
    false_alarm_rate: Part | None = None
    board: ShortText | None = None
    leak_ohm: Annotated[int, Meta(ge=1)] | None = None

    @property
    def why_not(self) -> str | None:
        """Why a law must not go by its figures, whatever the board and the calibration; None if it
        may.
        """
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
        if self.high < -LEAST_K:
            return (
                f"k = {self.k:.2f} ({self.low:.2f} to {self.high:.2f}): thresholds rise with the"
                " resistance, and more than a board's leak makes them; the law is made for skin"
                " that feels more where it resists more"
            )
        if self.k <= 0.0:
            return (
                f"k = {self.k:.2f}: thresholds rise with the resistance, or do not follow it, and"
                " the law is made for skin that feels more where it resists more (a board's leak"
                " does that by itself)"
            )
        if self.k > MOST_K:
            return f"k = {self.k:.2f} is not believed: none above {MOST_K:g} is known"
        if self.low <= 0.0 <= self.high:
            return (
                f"k = {self.k:.2f}, and its interval, {self.low:.2f} to {self.high:.2f}, has zero"
                " in it: thresholds may not follow the resistance at all"
            )
        if self.k < LEAST_K:
            return (
                f"k = {self.k:.2f} is less than {LEAST_K:g}: a board's leak has a part of that size"
                " in k, so that it is not known to be of the skin"
            )
        if max(self.k - self.low, self.high - self.k) > _MOST_OFF * self.k:
            return (
                f"k = {self.k:.2f}, and its interval, {self.low:.2f} to {self.high:.2f}, ends"
                " further from k than zero: it says little of k"
            )
        if (why := self._why_too_little) is not None:
            return why
        if self.board is None or self.leak_ohm is None:
            return (
                f"k = {self.k:.2f} was measured before its board was kept with it, and a board's"
                " leak has a part in it: measure it again (etd calibrate CODE --fit)"
            )
        return None

    @property
    def _why_too_little(self) -> str | None:
        """Where it is too little that is explained."""
        if self.explained < LEAST_EXPLAINED:
            return (
                f"k = {self.k:.2f} explains {self.explained:.0%} of what time leaves of what"
                f" thresholds did, less than {LEAST_EXPLAINED:.0%}"
            )
        if self.explained_of_all is None:
            return (
                f"k = {self.k:.2f} was measured before it was kept how much it explains of all that"
                " thresholds did: measure it again (etd calibrate CODE --fit)"
            )
        if self.explained_of_all < LEAST_EXPLAINED:
            return (
                f"k = {self.k:.2f} explains {self.explained_of_all:.0%} of all that thresholds did,"
                f" less than {LEAST_EXPLAINED:.0%}: the rest they did with time, or by themselves"
            )
        return None

    def why_not_in(
        self, calibrated: datetime.date, today: datetime.date | None = None
    ) -> str | None:
        """The same in a calibration of this day. `today`: where there is a wall clock."""
        if (why := self.why_not) is not None:
            return why
        if self.date < calibrated:
            return (
                f"k = {self.k:.2f} is of {self.date}, before the calibration that it stands in, of"
                f" {calibrated}: it was measured with another one; measure it again (etd calibrate"
                " CODE --fit)"
            )
        if today is not None and self.date > today + _AHEAD:
            return (
                f"k = {self.k:.2f} is of {self.date}, and today is {today}: one of the two is"
                " wrong; set the clock, or measure it again (etd calibrate CODE --fit); until then"
                " the engine, which knows no date, goes by it"
            )
        return None

    def why_not_on(self, board: str, leak_ohm: int, calibrated: datetime.date) -> str | None:
        """The same on this board, in a calibration of this day."""
        why = self.why_not_in(calibrated)
        if why is not None or (self.board, self.leak_ohm) == (board, leak_ohm):
            return why
        return (
            f"k = {self.k:.2f} was measured with {self.board} and its leak of {self.leak_ohm} ohm,"
            f" this is {board} with {leak_ohm} ohm, and a board's leak has a part in k: measure it"
            " again on this one (etd calibrate CODE --fit)"
        )


def usable_k(
    fitted: FittedExponent | None, board: str, leak_ohm: int, calibrated: datetime.date
) -> float | None:
    """k, where it may be used on this board, in a calibration of this day."""
    if fitted is None or fitted.why_not_on(board, leak_ohm, calibrated) is not None:
        return None
    return fitted.k


def check_exponent(
    fitted: FittedExponent | None, board: str, leak_ohm: int, calibrated: datetime.date, of: str
) -> None:
    """For a body site with `power_law`, which goes by the person's k and has none of its own.
    `calibrated`: the day of the calibration that it stands in; `of`: which one that is, in words.

    Raises: Refused (`bad_calibration`).
    """
    if fitted is None:
        raise no_exponent(f"{of} has none")
    if (why := fitted.why_not_on(board, leak_ohm, calibrated)) is not None:
        raise Refused("bad_calibration", f"{of}: power_law is not for this person: {why}")


def no_exponent(why: str = "none was measured") -> Refused:
    """For such a body site, of a lease without one."""
    return Refused(
        "bad_calibration",
        f"the body site's power_law goes by an exponent of the person's, and {why}: open with a"
        " calibration that has one (etd calibrate CODE --fit), or take power_law out of the body"
        " site",
    )
