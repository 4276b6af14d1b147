"""Equal strength does not depend on which of two comes second."""

from __future__ import annotations

import datetime

from msgspec.structs import replace

from calibrate_scenes import ROW
from etd.calibrate.answers import Presentation
from etd.calibrate.course import Course
from etd.calibrate.person import ResponseModel, SimulatedPerson
from etd.calibrate.progress import Progress, finished
from noisy_skin import NoisySkin

TODAY = datetime.date(2025, 3, 4)
CONDITIONS = replace(ROW, electrodes=16, array="grid-4x4", cap_ua=4_000)


def test_equal_strength_does_not_depend_on_what_comes_second() -> None:
    """The second of two feels stronger by a seventh: half of the electrodes' comparisons end with
    the reference, so that it is in neither's favor.
    """
    skin = NoisySkin(16, 19)
    skin.pain_ua = [4.0 * value for value in skin.threshold_ua]
    begun = Progress(conditions=CONDITIONS)
    Course(begun, skin, SimulatedPerson(skin.sense, 19), lambda: TODAY).run(range(16))
    made = finished(begun, TODAY, "test")
    shown: list[Presentation] = []
    medians = []
    for seed in (None, 3):
        progress = Progress(
            conditions=replace(CONDITIONS, method="equalize", reference=5), seed=seed
        )
        person = SimulatedPerson(skin.sense, 8, ResponseModel(second=0.14))
        course = Course(
            progress, skin, person, lambda: TODAY, baseline=made, on_presented=shown.append
        )
        found = course.run(range(16)).found
        reference = found[5].comfortable_ua / skin.threshold_ua[5]
        strong = sorted(
            limits.comfortable_ua / skin.threshold_ua[where] / reference
            for where, limits in found.items()
            if where != 5 and limits.comfortable_ua < limits.cap_ua
        )
        assert len(strong) >= 12
        medians.append(strong[len(strong) // 2])
    assert medians[0] < 0.92
    assert abs(medians[1] - 1.0) < 0.04
    lasts = [one.is_reference_last for one in shown if one.reference == 5]
    assert 0.15 < sum(lasts) / len(lasts) < 0.4, "half of the second round"
