"""Frame to first pulse on the modelled Pi 4: under a millisecond where the benchmark says so."""

from __future__ import annotations

from itertools import product

import pytest

from bench import front
from bench.latency_modelled import (
    CONFIGURATIONS,
    ELECTRODES_IN_USE,
    LOADS,
    MEETS,
    MOST_MS,
    RATE_HZ,
    STAGES,
    Load,
    measure,
)

FRAMES = 40
#: Where nothing is due, at factor 4.
POLL_US = 20.0


@pytest.mark.parametrize(
    ("configuration", "electrodes", "load"), [*product(CONFIGURATIONS, ELECTRODES_IN_USE, LOADS)]
)
def test_the_bounds_hold(configuration: str, electrodes: int, load: Load) -> None:
    found = measure(configuration, electrodes, load, FRAMES)
    assert len(found.frames) >= FRAMES
    # One that comes within a poll is read by it, all of which counts as its plan.
    assert min(min(frame) for frame in found.frames) >= -POLL_US
    assert found.whole_ms(0.99) <= 1e3 / RATE_HZ + MOST_MS == found.most_p99_ms
    if load == "standing":
        assert found.most_p50_ms is None
    elif (configuration, electrodes) in MEETS:
        assert found.whole_ms(0.5) <= MOST_MS == found.most_p50_ms
    else:
        assert MOST_MS < found.whole_ms(0.5) < 1.6, "say it where it holds"


def test_a_silent_display_waits_for_nothing() -> None:
    found = measure("compiled", 1, "silent", FRAMES)
    assert found.part_us("wait", 0.99) < 50.0
    assert [found.part_us(stage, 0.5) > 0.0 for stage in STAGES[1:]] == [True, True]


@pytest.mark.parametrize("electrodes", ELECTRODES_IN_USE)
def test_each_part_of_the_front_that_is_charged_is_measured(electrodes: int) -> None:
    """What they take here depends on the machine: `make bench` prints it beside what is charged."""
    found = front.measure(electrodes, 20)
    assert set(front.CHARGED_US) == set(front.PARTS)
    assert all(found.part_us(part, 0.1) > 0.0 for part in front.PARTS)
