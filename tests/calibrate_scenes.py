"""A calibration of four electrodes in a row that is under way, for tests of what is shown of one.

Owns: its conditions, and what was found of an electrode. Must not know: who shows it.
"""

from __future__ import annotations

from etd.calibrate.conditions import Conditions
from etd.protocol.calibration import ElectrodeLimits

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
