"""What is asked about one electrode: its procedures, one after another, within its bounds.

Owns: the first current of each electrode, its bounds, and the three figures from what was found.
Must not know: the order of electrodes (course), comparing with a reference (equal_strength), who
answers.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from typing import Protocol, TypeAlias

from msgspec.structs import replace

from etd.calibrate.answers import Answer
from etd.calibrate.asking import Asking
from etd.calibrate.comfortable import comfortable
from etd.calibrate.limits import Threshold, limits
from etd.calibrate.progress import Progress
from etd.calibrate.quest_plus import quest_plus, ready_questplus
from etd.calibrate.reach import Reach
from etd.calibrate.staircase import staircase
from etd.calibrate.trial import Procedure, Track
from etd.protocol.calibration import Calibration, ElectrodeLimits

#: The first current for a person without earlier results.
START_UA = 200
#: Further electrodes start at this part of the lowest threshold so far: thresholds differ by a
#: factor of two and more, and on some electrodes pain is near.
_OF_LEAST = 0.5
#: An electrode of the baseline starts at this part of its threshold there; steps are 10 % up to
#: this part of its comfortable level.
_OF_EARLIER = 0.8
#: In another state of the skin it starts at this part of it.
_OF_ANOTHER_STATE = 0.5

PROCEDURES: dict[str, Callable[[float], Procedure[Threshold]]] = {
    "limits": limits,
    "staircase": staircase,
    "quest-plus": quest_plus,
}


class Task:
    """One electrode under way: `present` shows a current there and returns the answer, `silent`
    asks the same about silence that stands for a current.
    """

    def __init__(
        self,
        electrode: int,
        track: Track[ElectrodeLimits],
        present: Callable[[int], Answer],
        silent: Callable[[int], None],
        is_check: bool = False,
    ) -> None:
        self.electrode = electrode
        self.track = track
        #: An electrode that has its figures is asked again: what it gives is not kept.
        self.is_check = is_check
        self._present = present
        self._silent = silent

    def trial(self) -> None:
        """One presentation and its question. Raises: Stopped, Unsettled, NotDelivered, Refused."""
        current_ua = self.track.current_ua
        self.track.hear(current_ua, self._present(current_ua))

    def silent_trial(self) -> None:
        """Like a trial, and silent where the current would be. Raises: as that one."""
        self._silent(self.track.current_ua)


class Tasks(Protocol):
    """What a course begins for each electrode."""

    def begin(self, electrode: int) -> Task: ...

    def check(self, electrode: int) -> Task | None:
        """Its threshold once more; None where the method finds none."""
        ...


class ThresholdTasks:
    """Threshold, then comfortable level and cap. `on_threshold` is called in between."""

    def __init__(
        self,
        progress: Progress,
        asking: Asking,
        baseline: Calibration | None,
        today: Callable[[], datetime.date],
        on_threshold: Callable[[int], None],
    ) -> None:
        self._progress = progress
        self._asking = asking
        self._baseline = baseline
        self._today = today
        self._on_threshold = on_threshold
        if progress.conditions.method == "quest-plus":
            ready_questplus()

    def begin(self, electrode: int) -> Task:
        cap_ua, start_ua = self._cap_ua(electrode), self._start_ua(electrode)
        reach = reach_of(self._progress, electrode, cap_ua, start_ua)
        return Task(
            electrode,
            Track(self._figures(electrode, reach), reach),
            lambda ua: self._asking.strength(electrode, reach, ua),
            lambda ua: self._asking.catch(electrode, ua),
        )

    def check(self, electrode: int) -> Task | None:
        found = self._progress.found[electrode]
        start_ua = max(1, int(found.threshold_ua * _OF_LEAST))
        reach = reach_of(self._progress, electrode, found.cap_ua, start_ua)
        return Task(
            electrode,
            Track(self._again(found, reach), reach),
            lambda ua: self._asking.strength(electrode, reach, ua),
            lambda ua: self._asking.catch(electrode, ua),
            is_check=True,
        )

    def _threshold(self, reach: Reach) -> Procedure[Threshold]:
        method = PROCEDURES[self._progress.conditions.method]
        threshold = yield from method(reach.most_ua)
        return threshold

    def _again(self, found: ElectrodeLimits, reach: Reach) -> Procedure[ElectrodeLimits]:
        """Not felt: its threshold is now this, or more."""
        threshold = yield from self._threshold(reach)
        now_ua = round(threshold.current_ua)
        return replace(found, threshold_ua=now_ua, felt=not threshold.is_least)

    def _figures(self, electrode: int, reach: Reach) -> Procedure[ElectrodeLimits]:
        before = self._earlier(electrode)
        known_ua = 0.0 if before is None else before.comfortable_ua * _OF_EARLIER
        threshold = yield from self._threshold(reach)
        self._on_threshold(electrode)
        from_ua = round(threshold.current_ua)
        at_ua, is_felt = min(from_ua, reach.cap_ua), threshold.is_felt
        if not is_felt:
            figures_ua = at_ua, at_ua, reach.tolerated_ua
        else:
            level = yield from comfortable(at_ua, known_ua=known_ua)
            figures_ua = at_ua, level.comfortable_ua, level.cap_ua
            is_felt = level.is_felt or level.cap_ua >= from_ua
        seen = self._asking.resistances.get(electrode, {})
        found = in_order(*figures_ua, seen, self._today(), is_felt=is_felt)
        if threshold.is_felt and not is_felt:
            # What was too strong has left less than it is felt from.
            return replace(found, felt_from_ua=from_ua)
        return found

    def _cap_ua(self, _: int) -> int:
        return self._progress.conditions.presented_ua

    def _start_ua(self, electrode: int) -> int:
        before = self._earlier(electrode)
        if before is not None and before.felt:
            return max(1, int(before.threshold_ua * _OF_EARLIER))
        felt_ua = [limits.threshold_ua for limits in self._progress.found.values() if limits.felt]
        return max(1, int(min(felt_ua) * _OF_LEAST)) if felt_ua else START_UA

    def _earlier(self, electrode: int) -> ElectrodeLimits | None:
        return None if self._baseline is None else self._baseline.electrode[electrode]


#: Caps and lowest thresholds, by electrode.
FitBounds: TypeAlias = tuple[Mapping[int, int], Mapping[int, int]]


class FitTasks(ThresholdTasks):
    """Thresholds alone, from far below those of the baseline: the skin is another one now.
    `bounds`: by electrode the most that is presented, and the lowest threshold so far.
    """

    def __init__(
        self,
        progress: Progress,
        asking: Asking,
        baseline: Calibration | None,
        today: Callable[[], datetime.date],
        on_threshold: Callable[[int], None],
        bounds: FitBounds,
    ) -> None:
        super().__init__(progress, asking, baseline, today, on_threshold)
        self._caps_ua, self._least_ua = bounds

    def check(self, electrode: int) -> None:
        """None: a state is short, and what drifts in it is what is measured."""
        del electrode

    def _cap_ua(self, electrode: int) -> int:
        return min(super()._cap_ua(electrode), self._caps_ua[electrode])

    def _figures(self, electrode: int, reach: Reach) -> Procedure[ElectrodeLimits]:
        threshold = yield from self._threshold(reach)
        self._on_threshold(electrode)
        at_ua = min(round(threshold.current_ua), reach.cap_ua)
        seen = self._asking.resistances.get(electrode, {})
        return in_order(at_ua, at_ua, at_ua, seen, self._today(), is_felt=threshold.is_felt)

    def _start_ua(self, electrode: int) -> int:
        before = self._earlier(electrode)
        least_ua = START_UA if before is None else before.threshold_ua
        return max(
            1, int(min(least_ua, self._least_ua.get(electrode, least_ua)) * _OF_ANOTHER_STATE)
        )


def reach_of(progress: Progress, electrode: int, cap_ua: int, start_ua: int) -> Reach:
    """Bounded by what was too strong there before."""
    return Reach(cap_ua, start_ua, lowered_ua=progress.lowered_ua.get(electrode))


def in_order(
    threshold_ua: int,
    comfortable_ua: int,
    cap_ua: int,
    resistances: dict[int, int],
    date: datetime.date,
    *,
    is_felt: bool = True,
) -> ElectrodeLimits:
    """The figures in rising order: of two that contradict each other the lower holds.

    `resistances`: in ohm, by current. The one of the nearest current is kept, since the resistance
    of skin depends on the current.
    """
    comfortable_ua = min(comfortable_ua, cap_ua)
    nearest_ua = min(resistances, key=lambda ua: abs(ua - comfortable_ua), default=None)
    return ElectrodeLimits(
        threshold_ua=min(threshold_ua, comfortable_ua),
        comfortable_ua=comfortable_ua,
        cap_ua=cap_ua,
        resistance_ohm=None if nearest_ua is None else resistances[nearest_ua],
        felt=is_felt,
        date=date,
    )
