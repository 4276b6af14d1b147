"""A machine that is slowed down while the engine runs: asked between scans, and told."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import pytest

from engine_rig import EngineRig
from engine_scenes import fully_open
from etd.engine.machine_watch import MachineWatch
from etd_hal.bench import CpuClock, Health

MakeRig = Callable[..., EngineRig]
SECOND = 1_000_000_000
HOT, WEAK = "it is slowed down", "it is short of voltage"


def test_the_machine_is_asked_every_five_seconds_at_most_and_each_beginning_is_counted() -> None:
    asked: list[int] = []
    now: tuple[str, ...] = ()
    counters: Counter[str] = Counter()

    def ask() -> tuple[str, ...]:
        asked.append(1)
        return now

    watch = MachineWatch(ask, counters)
    changes = {}
    for tenth in range(200):
        now = (HOT,) if tenth < 60 else (HOT, WEAK) if tenth < 120 else ()
        if watch.look(tenth * SECOND // 10):
            changes[tenth] = watch.troubles
    assert len(asked) == 4
    assert changes == {0: (HOT,), 100: (HOT, WEAK), 150: ()}
    assert counters["machine_slowed"] == 2


def test_of_a_machine_that_was_never_slowed_down_nothing_is_counted() -> None:
    """The engine's counters name what has happened, and nothing else."""
    counters: Counter[str] = Counter()
    watch = MachineWatch(tuple, counters)
    for second in range(0, 60, 5):
        assert not watch.look(second * SECOND)
    assert list(counters) == []


def test_it_is_asked_between_scans_and_told_in_the_next_report(make_rig: MakeRig) -> None:
    asked: list[bool] = []
    troubles: tuple[str, ...] = ()

    def ask() -> tuple[str, ...]:
        asked.append(rig_of[0].engine.is_between_scans if rig_of else True)
        return troubles

    rig_of: list[EngineRig] = []
    rig = make_rig(electrodes=16, wrap=lambda backend: replace(backend, troubles=ask))
    rig_of.append(rig)
    fully_open(rig, 400)
    assert not any(HOT in told for told in rig.engine.supervisor.limitations)
    troubles = (HOT,)
    rig.hold(6_000, current_ua=(400,) * 16, rate_hz=30.0)
    assert HOT in rig.engine.supervisor.limitations
    assert len(asked) <= 3
    assert all(asked)
    assert rig.state == "ARMED"


def test_what_is_told_of_a_machine_says_what_to_do() -> None:
    both = Health(None, is_throttled=True, is_under_voltage=True)
    assert [told.split(":")[0] for told in both.troubles] == [
        "the firmware slows the machine down now",
        "the machine is short of voltage now",
    ]
    assert Health(None, None, None).troubles == Health(90.0, False, False).troubles == ()


@pytest.mark.parametrize(
    ("clock", "is_fixed"),
    [
        (CpuClock("ondemand", 600_000, 1_800_000, 700_000), False),
        (CpuClock("performance", 600_000, 1_800_000, 1_800_000), True),
        (CpuClock("ondemand", 1_500_000, 1_500_000, 1_500_000), True),
    ],
)
def test_a_clock_is_fixed_by_its_governor_or_its_range(clock: CpuClock, is_fixed: bool) -> None:
    assert clock.is_fixed is is_fixed
    assert f"{clock.least_khz // 1_000} to {clock.most_khz // 1_000} MHz" in str(clock)
