"""A weaker frame that comes while a scan is under way: its falls hold from the next pulse."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import pytest

from engine_rig import EngineRig
from engine_scenes import (
    MS,
    armed,
    calibration,
    config,
    exponent,
    only,
    open_calibrated,
    opened_to,
    phases,
    scans,
)
from etd.files.configuration import LoadedConfig
from etd.protocol.calibration import ElectrodeLimits
from etd.protocol.link import Alive
from etd.stabilize.bursts import Bursts
from etd.stabilize.law_settings import PowerLawSettings
from etd.stabilize.settings import Settings
from etd.stabilize.strength_duration import StrengthDuration
from etd_body.electrode import skin
from trace_decoder import Phase

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
STRONG = {"current_ua": only(N, e3=1_000, e9=1_000), "width_us": 100}


def loaded_with(bursts: Bursts | None, board: str, electrodes: int) -> LoadedConfig:
    loaded = config(board, electrodes)
    site = msgspec.structs.replace(loaded.body_site, stabilize=Settings(bursts=bursts))
    return dataclasses.replace(loaded, body_site=site)


def bursting(
    make_rig: MakeRig, bursts: Bursts | None, board: str = "kajimoto-hv507", electrodes: int = N
) -> EngineRig:
    """Open to 1 mA, and silent since."""
    rig = armed(make_rig(loaded=loaded_with(bursts, board, electrodes)))
    for number in range(1, 60):
        # A scan may outlast the patience with a gateway that cannot speak meanwhile.
        rig.clock.at(rig.clock.now_ns() + number * 50 * MS, lambda: rig.commands.send(Alive()))
    opened_to(rig, 1_000)
    rig.hold(500, current_ua=only(electrodes, e0=20), rate_hz=2.0, ttl_ms=700)
    rig.run_ms(710)
    rig.answers.clear()
    return rig


def midway(rig: EngineRig, after_ms: float, rate_hz: float, *newer: dict[str, Any]) -> int:
    """Show the strong frame, and so much later each newer one; when the last one was sent."""
    begun_ns = rig.clock.now_ns()
    rig.send(**STRONG, rate_hz=rate_hz, ttl_ms=1_000)
    sent_ns = begun_ns
    for number, entry in enumerate(newer):
        sent_ns = begun_ns + int((after_ms + number) * MS)
        fields = {"rate_hz": rate_hz, "ttl_ms": 900, **entry}
        rig.clock.at(sent_ns, partial(rig.send, **fields))
    rig.run_ms(700)
    assert all(answer.error is None for answer in rig.answers.values())
    return sent_ns


def of(rig: EngineRig, electrode: int, since_ns: int, until_ns: int | None = None) -> list[Phase]:
    return [
        phase
        for phase in phases(rig, since_ns)
        if phase.electrode == electrode and (until_ns is None or phase.from_ns < until_ns)
    ]


BURSTS = [
    (Bursts(pulses=2, rate_hz=350.0), 15.0, 1.5),
    (Bursts(pulses=6, rate_hz=350.0), 15.0, 7.0),
    (Bursts(pulses=20, rate_hz=50.0), 2.0, 90.0),
]


@pytest.mark.parametrize(("bursts", "rate_hz", "after_ms"), BURSTS)
@pytest.mark.parametrize(
    "weaker",
    [
        {"current_ua": only(N, e9=1_000), "width_us": 100},
        {"current_ua": only(N, e3=300, e9=1_000), "width_us": 100},
        {"current_ua": only(N, e3=1_000, e9=1_000), "width_us": (100,) * 3 + (50,) + (100,) * 12},
        {"current_ua": only(N, e3=1_200, e9=1_000), "width_us": (100,) * 3 + (50,) + (100,) * 12},
    ],
    ids=["silent", "less current", "narrower", "narrower, with more current"],
)
def test_in_a_burst_a_fall_holds_from_the_next_pulse(
    make_rig: MakeRig, bursts: Bursts, rate_hz: float, after_ms: float, weaker: dict[str, Any]
) -> None:
    rig = bursting(make_rig, bursts)
    shown_ns = rig.clock.now_ns()
    sent_ns = midway(rig, after_ms, rate_hz, weaker)
    before = of(rig, 3, shown_ns, sent_ns)
    assert 1 <= len(before) < bursts.pulses
    assert all(phase.charge_pc > 90_000 for phase in before)
    assert all(phase.charge_pc < 61_000 for phase in of(rig, 3, sent_ns))
    burst_ns = int(bursts.pulses * bursts.interval_us * 1_000)
    others = of(rig, 9, shown_ns, shown_ns + burst_ns + MS)
    assert len(others) == bursts.pulses, "who has not fallen keeps the rhythm"


def test_what_fell_goes_on_weaker_in_the_same_burst(make_rig: MakeRig) -> None:
    rig = bursting(make_rig, BURSTS[1][0])
    shown_ns = rig.clock.now_ns()
    weaker = {"current_ua": only(N, e3=300, e9=1_000), "width_us": 100}
    midway(rig, 7.0, 15.0, weaker)
    burst = [round(phase.current_ua, -2) for phase in of(rig, 3, shown_ns, shown_ns + 30 * MS)]
    assert burst == [1_000, 1_000, 1_000, 300, 300, 300]


def test_a_rise_waits_for_the_next_burst(make_rig: MakeRig) -> None:
    rig = bursting(make_rig, BURSTS[1][0])
    shown_ns, superseded = (
        rig.clock.now_ns(),
        rig.engine.components.reporter.counters["frames_superseded"],
    )
    weaker = {"current_ua": only(N, e3=300), "width_us": 100}
    stronger = {"current_ua": only(N, e3=800), "width_us": 100}
    midway(rig, 7.0, 15.0, weaker, stronger)
    found = [round(phase.current_ua, -2) for phase in of(rig, 3, shown_ns, shown_ns + 90 * MS)]
    assert found == [1_000] * 3 + [300] * 3 + [800] * 6
    assert rig.engine.components.reporter.counters["frames_superseded"] == superseded + 1


def test_a_frame_that_is_refused_takes_nothing_from_a_burst(make_rig: MakeRig) -> None:
    rig = bursting(make_rig, BURSTS[1][0])
    begun_ns = rig.clock.now_ns()
    rig.send(**STRONG, rate_hz=15.0, ttl_ms=1_000)
    rig.clock.at(begun_ns + 7 * MS, lambda: rig.send(current_ua=only(N, e3=9_000, e9=300)))
    rig.run_ms(60)
    assert {answer.error for answer in rig.answers.values()} == {None, "over_maximum"}
    assert [round(phase.current_ua, -2) for phase in of(rig, 9, begun_ns)] == [1_000] * 6


def test_a_newer_frame_whose_time_is_over_before_its_scan_is_told(make_rig: MakeRig) -> None:
    rig = bursting(make_rig, BURSTS[2][0])
    begun_ns = rig.clock.now_ns()
    rig.send(**STRONG, rate_hz=2.0, ttl_ms=1_000)
    rig.clock.at(
        begun_ns + 90 * MS, lambda: rig.send(current_ua=only(N, e3=300), rate_hz=2.0, ttl_ms=100)
    )
    rig.run_ms(600)
    refused = [report.refused for report in rig.reports if report.refused is not None]
    assert [refused_report.error for refused_report in refused] == ["expired"]
    assert max(phase.current_ua for phase in of(rig, 3, begun_ns + 95 * MS)) < 301, "it has fallen"
    assert rig.last_seq not in {shown.seq for scan in scans(rig) for shown in scan.shown}


def test_in_a_long_scan_of_a_stack_of_boards_a_fall_waits_for_a_twentieth_of_a_second(
    make_rig: MakeRig,
) -> None:
    rig = bursting(make_rig, None, "etactilekit-hv513-x8", 256)
    begun_ns = rig.clock.now_ns()
    rig.send(current_ua=(500,) * 256, width_us=100, rate_hz=1.0, ttl_ms=1_000)
    rig.clock.at(begun_ns + 20 * MS, lambda: rig.send(current_ua=(0,) * 256, ttl_ms=900))
    rig.run_ms(800)
    found = phases(rig, begun_ns)
    assert 1 < len(found) < 256
    assert begun_ns + 40 * MS < found[-1].from_ns < begun_ns + 53 * MS


def test_a_current_that_is_named_holds_at_once_for_a_level_that_a_law_makes_stronger(
    make_rig: MakeRig,
) -> None:
    """A law in this order widens a pulse, which is made narrower and stronger again."""
    settings = Settings(
        order=("power_law", "strength_duration"),
        power_law=PowerLawSettings(max_widening=4.0, rise_per_s=20.0),
        strength_duration=StrengthDuration(width_us=50, tau_us=151.0),
        bursts=Bursts(pulses=6, rate_hz=350.0),
    )
    loaded = loaded_with(None, "kajimoto-hv507", N)
    site = msgspec.structs.replace(loaded.body_site, stabilize=settings)
    rig = make_rig(loaded=dataclasses.replace(loaded, body_site=site))
    limits = ElectrodeLimits(
        threshold_ua=500, comfortable_ua=1_000, cap_ua=3_000, resistance_ohm=60_000
    )
    changes: dict[str, Any] = {"electrode": (limits,) * N, "width_us": 50, "rate_hz": 15.0}
    made = calibration(rig, (3_000,) * N, shape=settings.shape, exponent=exponent(1.0), **changes)
    assert open_calibrated(rig, made).error is None
    rig.arm()
    rig.fake.world.touch(3, skin(1_000.0, 19_000.0, 0.8))
    rig.hold(700, level=only(N, e3=1), ttl_ms=200)
    rig.run_ms(300)
    begun_ns = rig.clock.now_ns()
    named_ns = begun_ns + 7 * MS
    rig.send(level=only(N, e3=1), ttl_ms=1_000)
    named = {"current_ua": only(N, e3=1_000), "width_us": 50, "rate_hz": 15.0}
    rig.clock.at(named_ns, partial(rig.send, **named))
    rig.run_ms(60)
    assert all(answer.error is None for answer in rig.answers.values())
    before = [phase.current_ua for phase in of(rig, 3, begun_ns, named_ns)]
    after = [phase.current_ua for phase in of(rig, 3, named_ns, begun_ns + 30 * MS)]
    assert len(before) + len(after) == 6, "one burst"
    assert min(before) > 1_100
    assert max(after) <= 1_000
    assert rig.close() == ()
