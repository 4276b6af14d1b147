"""A calibration of four electrodes in a row that is under way.

Owns: its conditions, what was found of an electrode, and sittings that go on from what was kept.
Must not know: who shows it, what is answered, what is expected.
"""

from __future__ import annotations

import datetime
from pathlib import Path

from msgspec.structs import replace

from etd.calibrate.answers import Answerer
from etd.calibrate.conditions import Conditions
from etd.calibrate.course import Course
from etd.calibrate.progress import Progress, load_progress, save_progress
from etd.protocol.calibration import Calibration, ElectrodeLimits
from noisy_skin import NoisySkin

TODAY = datetime.date(2025, 3, 4)

ROW = Conditions(
    participant="P01",
    method="limits",
    body_site="fingertip",
    array="row",
    electrodes=4,
    polarity="anodic",
    width_us=100,
    rate_hz=60.0,
    returns="all",
    pulses=10,
    cap_ua=3_000,
)
FOUND = ElectrodeLimits(threshold_ua=1_111, comfortable_ua=2_222, cap_ua=2_333)

#: In place of the method's own: each is made as strong as this one, of that calibration.
REFERENCE = 1
EQUAL = replace(ROW, method="equalize", reference=REFERENCE, baseline="P01")
BASELINE = Calibration(
    participant="P01",
    body_site="fingertip",
    array="row",
    polarity="anodic",
    width_us=100,
    rate_hz=60.0,
    returns="all",
    date=TODAY,
    program="test",
    electrode=(ElectrodeLimits(threshold_ua=1_000, comfortable_ua=1_700, cap_ua=2_000),) * 4,
)


class Sittings:
    """One calibration, in several sittings: what is kept between them is in a file."""

    def __init__(self, folder: Path, conditions: Conditions = ROW) -> None:
        self.path = folder / "P01.json"
        self.skin = NoisySkin(4, 5)
        self._conditions = conditions

    @property
    def kept(self) -> Progress:
        if not self.path.exists():
            return Progress(conditions=self._conditions)
        return load_progress(self.path, self._conditions)

    def course(self, answerer: Answerer, *, asks_sensation: bool = False) -> Course:
        """From there."""
        return Course(
            self.kept,
            self.skin,
            answerer,
            lambda: TODAY,
            baseline=BASELINE if self._conditions.reference is not None else None,
            on_progress=lambda now: save_progress(self.path, now),
            asks_sensation=asks_sensation,
        )
