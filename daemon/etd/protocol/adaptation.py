"""Whether a person feels less and less in use: what their word may raise a level for.

Owns: the type, and when it lets answers raise. Must not know: how it is asked, what is raised and
by how much, calibrations.
"""

from __future__ import annotations

import datetime
from typing import Annotated

import msgspec
from msgspec import Meta

#: Of the answers that count, the part that says *weaker*, and how many there are at least. Who
#: feels it as at first, and errs one time of five to either side, says it so often by a chance of
#: 0.0000001; who feels less and errs as often, by one of 0.99.
LEAST_WEAKER, LEAST_ANSWERS = 0.6, 20
#: Who says *stronger* more often than this says something else than that it is felt less; who errs
#: as often as that does so by a chance of 0.002.
MOST_STRONGER = 0.3
#: In less than eight minutes half of what matters may not have come yet: adaptation takes a quarter
#: of an hour (Kaczmarek 2000 [abs]).
LEAST_USE_S = 480.0
#: Midnight comes at another time elsewhere.
_AHEAD = datetime.timedelta(days=1)
MEASURE_AGAIN = "measure it again (etd calibrate CODE --adaptation)"

Count = Annotated[int, Meta(ge=0, le=1_000)]


class MeasuredAdaptation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Of the `answers` in the second half of `use_s`, the whole array in use at one strength: how
    many said that it was `weaker` than at first, and how many `stronger`. `weaker_from_s`: the use
    from which on most of all answers were *weaker*, above `use_s` if none; None: it is not told.
    """

    answers: Annotated[int, Meta(ge=1, le=1_000)]
    weaker: Count
    stronger: Count
    use_s: Annotated[float, Meta(ge=1.0, le=86_400.0)]
    weaker_from_s: Annotated[float, Meta(gt=0.0, le=172_800.0)] | None = None
    date: datetime.date

    @property
    def in_words(self) -> str:
        told = (
            f"in the second half of {self.use_s:g} s of use, {self.weaker} of {self.answers}"
            f" answers were weaker, {self.stronger} stronger"
        )
        if self.weaker_from_s is None or self.weaker_from_s > self.use_s:
            return told
        return f"{told}; it was weaker from {self.weaker_from_s:.0f} s on"

    def why_not_in(
        self, calibrated: datetime.date, today: datetime.date | None = None
    ) -> str | None:
        """Why answers must not raise by it in a calibration of this day, beside what was found
        (`in_words`); None if they may. `today`: where there is a wall clock.
        """
        if self.weaker + self.stronger > self.answers:
            return "these are more than there were"
        if self.answers < LEAST_ANSWERS:
            return f"at least {LEAST_ANSWERS} answers are needed"
        if self.use_s < LEAST_USE_S:
            return f"at least {LEAST_USE_S:g} s are needed"
        if self.weaker < LEAST_WEAKER * self.answers:
            return f"below {LEAST_WEAKER:.0%} weaker, nothing has to be made up for"
        if self.stronger > MOST_STRONGER * self.answers:
            return f"more than {MOST_STRONGER:.0%} stronger: it goes up and down"
        if (why := self._why_not_from()) is not None:
            return why
        if self.date < calibrated:
            return (
                f"it is of {self.date}, before the calibration that it stands in, of {calibrated}:"
                f" {MEASURE_AGAIN}"
            )
        if today is not None and self.date > today + _AHEAD:
            return (
                f"it is of {self.date}, and today is {today}: set the clock, or {MEASURE_AGAIN};"
                " until then the engine, which knows no date, goes by it"
            )
        return None

    def _why_not_from(self) -> str | None:
        """Why it cannot have been weaker from then on."""
        if self.weaker_from_s is None:
            return None
        if self.weaker_from_s > self.use_s:
            return f"weaker_from_s, {self.weaker_from_s:g} s, is after the last of these answers"
        if self.weaker_from_s < self.use_s / (2 * self.answers + 2):
            return f"weaker_from_s, {self.weaker_from_s:g} s, is before the first answer"
        return None


def why_not_raised(
    adaptation: MeasuredAdaptation | None,
    calibrated: datetime.date,
    today: datetime.date | None = None,
) -> str | None:
    """Why answers raise nothing above the frame's own for this person; None if they may."""
    if adaptation is None:
        return (
            "it was not measured that this person feels less in use (etd calibrate CODE"
            " --adaptation)"
        )
    why = adaptation.why_not_in(calibrated, today)
    return None if why is None else f"{adaptation.in_words}: {why}"
