"""Making every electrode as strong as a reference: what of it concerns a baseline.

Owns: which electrode may be the reference, approaching it before it is used and in between, and the
figures that are taken over from the baseline. Must not know: the order of electrodes, steps
(equalize), who answers.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Collection, Sequence

from msgspec.structs import replace

from etd.calibrate.answers import Answer
from etd.calibrate.asking import Asking, too_strong_reference
from etd.calibrate.comfortable import HEADROOM
from etd.calibrate.equalize import equalize, lead_up
from etd.calibrate.order import CHECK_EACH
from etd.calibrate.progress import Progress
from etd.calibrate.reach import Reach
from etd.calibrate.tasks import Task, in_order, reach_of
from etd.calibrate.trial import BelowThreshold, Procedure, Track, run
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import Refused

#: Differences of room above the comfortable level that count when a reference is chosen.
_ROOM_STEP = 0.05


class EqualTasks:
    """Raises, when made: Refused (`limits_missing`, `bad_calibration`)."""

    def __init__(
        self,
        progress: Progress,
        asking: Asking,
        baseline: Calibration | None,
        today: Callable[[], datetime.date],
    ) -> None:
        reference = progress.conditions.reference
        if baseline is None or reference is None:
            raise Refused(
                "limits_missing",
                "equalize needs a calibration of this person and a reference electrode: name a"
                " --baseline",
            )
        if reference >= len(baseline.electrode) or not baseline.electrode[reference].felt:
            raise Refused(
                "bad_calibration",
                f"electrode {reference} was not felt in the baseline, so it cannot be the"
                " reference: name another --reference",
                reference,
            )
        self._progress = progress
        self._asking = asking
        self._baseline = baseline
        self._reference = reference
        self._today = today
        self._until_led_up = 0
        if self._reach_of_reference().is_cap_felt:
            raise too_strong_reference(reference)

    def begin(self, electrode: int) -> Task:
        """Raises: Refused (`bad_calibration`), and what a presentation raises: the reference is
        approached before the first comparison.
        """
        before = self._baseline.electrode[electrode]
        reach = reach_of(self._progress, electrode, before.cap_ua, before.threshold_ua)
        reference = self._reference
        if electrode != reference and before.felt:
            self._lead_up()
            procedure = self._matched(electrode, before, reach)
        else:
            procedure = _taken_over(replace(before, date=before.date or self._baseline.date))
        reference_ua = self._baseline.electrode[reference].comfortable_ua

        def present(current_ua: int) -> Answer:
            if reach.cap_ua < before.threshold_ua:
                raise BelowThreshold(electrode)
            return self._asking.compared(electrode, reach, current_ua, reference, reference_ua)

        def silent(stands_for_ua: int) -> None:
            self._asking.catch_compared(electrode, stands_for_ua, reference, reference_ua)

        return Task(electrode, Track(procedure, reach), present, silent)

    def check(self, _: int) -> None:
        return None

    def _matched(
        self, electrode: int, before: ElectrodeLimits, reach: Reach
    ) -> Procedure[ElectrodeLimits]:
        """The baseline's caps hold; figures that are taken over keep their date."""
        matched_ua = yield from equalize(before.threshold_ua)
        cap_ua = reach.cap_ua
        seen = self._asking.resistances.get(electrode, {})
        found = in_order(before.threshold_ua, min(matched_ua, cap_ua), cap_ua, seen, self._today())
        found_on = before.date or self._baseline.date
        return replace(found, threshold_date=before.threshold_date or found_on)

    def _lead_up(self) -> None:
        """An ascent to the reference's level, before the first comparison and after each so many
        electrodes: skin may have changed. Raises: Refused.
        """
        self._until_led_up -= 1
        if self._until_led_up > 0:
            return
        reference, limits = self._reference, self._baseline.electrode[self._reference]
        reach = self._reach_of_reference()
        procedure = lead_up(limits.threshold_ua, limits.comfortable_ua)
        answer = run(procedure, reach, lambda ua: self._asking.strength(reference, reach, ua))
        if answer == "too_strong":
            raise too_strong_reference(reference)
        if answer == "not_felt":
            raise _unfelt_reference(reference)
        self._until_led_up = CHECK_EACH

    def _reach_of_reference(self) -> Reach:
        limits = self._baseline.electrode[self._reference]
        return reach_of(self._progress, self._reference, limits.comfortable_ua, limits.threshold_ua)


def default_reference(
    baseline: Calibration | None,
    x_mm: Sequence[float],
    y_mm: Sequence[float],
    left_out: Collection[int] = (),
) -> int:
    """Of the electrodes with the most room above their comfortable level, the one nearest to the
    middle: it is presented in every comparison, and once too strong would end them all. `left_out`:
    not all of them; these are not presented.
    """
    each = () if baseline is None else baseline.electrode[: len(x_mm)]
    presented = [index for index in range(len(x_mm)) if index not in left_out]
    felt = [index for index in presented if each and each[index].felt]
    middle_x, middle_y = sum(x_mm) / len(x_mm), sum(y_mm) / len(y_mm)

    def order(electrode: int) -> tuple[float, float]:
        away = (x_mm[electrode] - middle_x) ** 2 + (y_mm[electrode] - middle_y) ** 2
        if not each:
            return 0.0, away
        room = each[electrode].cap_ua / max(1, each[electrode].comfortable_ua)
        return -round(min(HEADROOM, room) / _ROOM_STEP), away

    return min(felt or presented, key=order)


def _unfelt_reference(reference: int) -> Refused:
    """Everything would be as strong as it."""
    return Refused(
        "bad_calibration",
        f"the reference, electrode {reference}, is not felt any more at its comfortable level of"
        " the baseline: thresholds have risen. The same command tries it again, after a rest; or"
        " make a new calibration",
        reference,
    )


def _taken_over(limits: ElectrodeLimits) -> Procedure[ElectrodeLimits]:
    """Without a presentation."""
    yield from ()
    return limits
