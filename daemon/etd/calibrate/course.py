"""A whole calibration: electrode after electrode, until each has its three figures.

Owns: the order, the first current of each electrode, its bounds, and saving the progress after
each. Must not know: presentations and questions (asking), who answers, where progress is stored.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence

import msgspec

from etd.calibrate.answers import Answer, Answerer
from etd.calibrate.asking import Asking, Presenter, too_strong_reference
from etd.calibrate.comfortable import comfortable
from etd.calibrate.conditions import check_baseline
from etd.calibrate.equalize import equalize, lead_up
from etd.calibrate.limits import Threshold, limits
from etd.calibrate.progress import Progress
from etd.calibrate.quest_plus import quest_plus, ready_questplus
from etd.calibrate.reach import Reach
from etd.calibrate.staircase import staircase
from etd.calibrate.stimulator import NotDelivered
from etd.calibrate.trial import BelowThreshold, Procedure, R, Unsettled, run
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import Refused

#: The first current for a person without earlier results.
START_UA = 200
#: Further electrodes start at this part of the lowest threshold so far: thresholds differ by a
#: factor of two and more, and on some electrodes pain is near.
_OF_LEAST = 0.5
#: An electrode of the baseline starts at this part of its threshold there; steps are 10 % up to
#: this part of its comfortable level.
_OF_EARLIER = 0.8

PROCEDURES: dict[str, Callable[[float], Procedure[Threshold]]] = {
    "limits": limits,
    "staircase": staircase,
    "quest-plus": quest_plus,
}


class Course:
    """`progress` is filled in; `on_progress` is called with it after each electrode, and at once
    when something was too strong. `on_presented` is called with the electrode of each presentation,
    `on_threshold` when an electrode's threshold is found, `on_found` when it has all figures.
    `today` dates each electrode: a calibration may continue on another day.

    `baseline`: an earlier calibration of the same person, which gives the first currents; the
    method `equalize` takes over all of it except the comfortable levels.
    """

    def __init__(
        self,
        progress: Progress,
        presenter: Presenter,
        answerer: Answerer,
        today: Callable[[], datetime.date],
        *,
        baseline: Calibration | None = None,
        on_progress: Callable[[Progress], None] = lambda _: None,
        on_presented: Callable[[int], None] = lambda _: None,
        on_threshold: Callable[[int], None] = lambda _: None,
        on_found: Callable[[int], None] = lambda _: None,
    ) -> None:
        self._progress = progress
        self._asking = Asking(progress, presenter, answerer, on_progress, on_presented)
        self._today = today
        self._baseline = baseline
        self._reference = progress.conditions.reference
        self._on_progress = on_progress
        self._on_threshold = on_threshold
        self._on_found = on_found
        self._is_led_up = False
        self.left: dict[int, str] = {}
        self._check()

    def _check(self) -> None:
        conditions = self._progress.conditions
        if self._baseline is not None:
            check_baseline(conditions, self._baseline)
        if conditions.method == "equalize":
            self._check_reference()
        if conditions.method == "quest-plus":
            ready_questplus()

    def _check_reference(self) -> None:
        baseline, reference = self._baseline, self._reference
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
        if self._reach_of_reference(reference, baseline).is_cap_felt:
            raise too_strong_reference(reference)

    def run(self, electrodes: Sequence[int]) -> Progress:
        """Calibrate those that have no result yet. Those that still have none are in `left`, with
        the reason. Raises: Stopped, Refused, DaemonGone.
        """
        for electrode in electrodes:
            if electrode in self._progress.found:
                continue
            try:
                found = self._calibrated(electrode)
            except (NotDelivered, Unsettled, BelowThreshold) as error:
                self.left[electrode] = str(error)
                continue
            self._progress.found[electrode] = found
            self.left.pop(electrode, None)
            self._on_progress(self._progress)
            self._on_found(electrode)
        return self._progress

    # --- one electrode -----------------------------------------------------------------------

    def _calibrated(self, electrode: int) -> ElectrodeLimits:
        self._asking.resistances.clear()
        conditions, baseline, reference = self._progress.conditions, self._baseline, self._reference
        if conditions.method == "equalize" and baseline is not None and reference is not None:
            return self._equalized(electrode, baseline, reference)
        before = self._earlier(electrode)
        reach = self._reach(electrode, conditions.presented_ua, self._start_ua(electrode))
        threshold = self._run(PROCEDURES[conditions.method](reach.most_ua), electrode, reach)
        self._on_threshold(electrode)
        at_ua = min(round(threshold.current_ua), reach.cap_ua)
        if not threshold.is_felt:
            return self._limits(at_ua, at_ua, reach.tolerated_ua, is_felt=False)
        known_ua = 0.0 if before is None else before.comfortable_ua * _OF_EARLIER
        level = self._run(comfortable(at_ua, known_ua=known_ua), electrode, reach)
        return self._limits(at_ua, level.comfortable_ua, level.cap_ua)

    def _equalized(self, electrode: int, baseline: Calibration, reference: int) -> ElectrodeLimits:
        """The baseline's caps hold; figures that are taken over keep their date."""
        before = baseline.electrode[electrode]
        found_on = before.date or baseline.date
        if electrode == reference or not before.felt:
            return msgspec.structs.replace(before, date=found_on)
        self._lead_up_to(reference, baseline)
        reach = self._reach(electrode, before.cap_ua, before.threshold_ua)
        reference_ua = baseline.electrode[reference].comfortable_ua

        def present(current_ua: int) -> Answer:
            if reach.cap_ua < before.threshold_ua:
                raise BelowThreshold(electrode)
            return self._asking.compared(electrode, reach, current_ua, reference, reference_ua)

        matched_ua = run(equalize(before.threshold_ua), reach, present)
        cap_ua = reach.cap_ua
        found = self._limits(before.threshold_ua, min(matched_ua, cap_ua), cap_ua)
        return msgspec.structs.replace(found, threshold_date=before.threshold_date or found_on)

    def _lead_up_to(self, reference: int, baseline: Calibration) -> None:
        """An ascent to its level: skin may have changed. Raises: Refused (`bad_calibration`)."""
        if self._is_led_up:
            return
        limits = baseline.electrode[reference]
        procedure = lead_up(limits.threshold_ua, limits.comfortable_ua)
        if not self._run(procedure, reference, self._reach_of_reference(reference, baseline)):
            raise too_strong_reference(reference)
        self._is_led_up = True

    def _reach_of_reference(self, reference: int, baseline: Calibration) -> Reach:
        limits = baseline.electrode[reference]
        return self._reach(reference, limits.comfortable_ua, limits.threshold_ua)

    def _reach(self, electrode: int, cap_ua: int, start_ua: int) -> Reach:
        """Bounded by what was too strong there before."""
        return Reach(cap_ua, start_ua, lowered_ua=self._progress.lowered_ua.get(electrode))

    def _run(self, procedure: Procedure[R], electrode: int, reach: Reach) -> R:
        """Run a procedure that asks for strength. Raises: Stopped, Unsettled, NotDelivered."""
        return run(procedure, reach, lambda ua: self._asking.strength(electrode, reach, ua))

    def _limits(
        self, threshold_ua: int, comfortable_ua: int, cap_ua: int, is_felt: bool = True
    ) -> ElectrodeLimits:
        """The figures in rising order: of two that contradict each other the lower holds."""
        comfortable_ua = min(comfortable_ua, cap_ua)
        return ElectrodeLimits(
            threshold_ua=min(threshold_ua, comfortable_ua),
            comfortable_ua=comfortable_ua,
            cap_ua=cap_ua,
            resistance_ohm=self._resistance_at(comfortable_ua),
            felt=is_felt,
            date=self._today(),
        )

    def _resistance_at(self, current_ua: int) -> int | None:
        """The last one at the nearest current: the resistance of skin depends on the current."""
        seen = self._asking.resistances
        return seen[min(seen, key=lambda ua: abs(ua - current_ua))] if seen else None

    def _start_ua(self, electrode: int) -> int:
        before = self._earlier(electrode)
        if before is not None and before.felt:
            return max(1, int(before.threshold_ua * _OF_EARLIER))
        felt_ua = [limits.threshold_ua for limits in self._progress.found.values() if limits.felt]
        return max(1, int(min(felt_ua) * _OF_LEAST)) if felt_ua else START_UA

    def _earlier(self, electrode: int) -> ElectrodeLimits | None:
        return None if self._baseline is None else self._baseline.electrode[electrode]
