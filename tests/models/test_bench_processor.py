"""The benchmark of the engine's processor time measures every pulse of its scans, and no other."""

from __future__ import annotations

import pytest

from bench.modelled import ELECTRODES
from bench.processor import measure
from etd.stabilize.settings import NO_STABILIZERS, Settings

SCANS = 25


@pytest.mark.parametrize("stabilize", [NO_STABILIZERS, Settings(order=(), probe_first=True)])
def test_the_time_between_all_pulses_of_a_scan_is_measured(stabilize: Settings) -> None:
    # 25 scans at 20 Hz, and those before: the source is checked in between.
    figures = measure(SCANS, stabilize)
    assert figures.pulses == SCANS * (ELECTRODES - 1)
    assert 0.0 < figures.median_us <= figures.p99_us
