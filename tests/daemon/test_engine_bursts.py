"""Bursts, from the body-site file to the wires: who, when, and what the limits make of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import msgspec
import pytest

from engine_parts import array, board_file, body_site, currents, frame, planner
from engine_rig import EngineRig
from engine_scenes import MS, armed, config, fully_open, moves, only, phases, scans
from etd.files.body_site import BodySite
from etd.files.configuration import LoadedConfig
from etd.protocol.errors import Refused
from etd.stabilize.bursts import Bursts
from etd.stabilize.settings import Settings
from trace_decoder import Phase
from trace_rules import violations

MakeRig = Callable[..., EngineRig]
N = 16
SIX = Bursts(pulses=6, rate_hz=350.0)
BURST_US = SIX.interval_us


def bursting(site: BodySite, bursts: Bursts = SIX, **maxima: int) -> BodySite:
    """A site that has these bursts, at 15 Hz."""
    return msgspec.structs.replace(
        site,
        stabilize=Settings(bursts=bursts),
        maxima=msgspec.structs.replace(site.maxima, **maxima),
        defaults=msgspec.structs.replace(site.defaults, rate_hz=15.0),
    )


def loaded_with(bursts: Bursts = SIX, board: str = "kajimoto-hv507", **maxima: int) -> LoadedConfig:
    loaded = config(board, N)
    return dataclasses.replace(loaded, body_site=bursting(loaded.body_site, bursts, **maxima))


def begun_us(found: Sequence[Phase], electrode: int) -> list[float]:
    return [phase.from_ns / 1_000 for phase in found if phase.electrode == electrode]


def apart_us(found: Sequence[Phase], electrode: int) -> list[float]:
    return [later - earlier for earlier, later in pairwise(begun_us(found, electrode))]


def refusal_of(**fields: Any) -> Refused:
    made = planner(site=bursting(body_site()))
    with pytest.raises(Refused) as refusal:
        made.plan(frame(**fields))
    return refusal.value


# --- on the wires ---------------------------------------------------------------------------------


def test_each_electrode_gets_its_burst_of_pulses_at_the_rate_inside_it(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=loaded_with()), 1_000)
    rig.run_ms(300)
    since_ns = rig.clock.now_ns()
    rig.hold(200, current_ua=only(N, e3=800, e9=800), width_us=100)
    found = phases(rig, since_ns)
    for electrode in (3, 9):
        apart = apart_us(found, electrode)
        within = [value for value in apart if value < 10_000]
        between = [value for value in apart if value >= 10_000]
        assert len(within) == 5 * (len(between) + 1)
        assert within == pytest.approx([BURST_US] * len(within), abs=150)
        assert min(within) >= BURST_US
        assert len(between) >= 2
        assert between == pytest.approx([1e6 / 15 - 5 * BURST_US] * len(between), abs=400)


def test_the_electrodes_of_a_group_take_turns_and_the_next_group_follows(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(loaded=loaded_with()), 1_000)
    rig.run_ms(300)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=(800,) * N, width_us=100, ttl_ms=60)
    rig.run_ms(60)
    order = [phase.electrode for phase in phases(rig, since_ns)]
    groups = [list(range(first, N, 2)) for first in range(2)]
    assert order == [electrode for group in groups for electrode in group * 6]


def test_a_scan_in_bursts_breaks_no_rule_of_the_wires(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=loaded_with()), 1_000)
    rig.hold(150, current_ua=(800,) * N, width_us=100)
    assert rig.close() == ()
    assert violations(rig.trace(), 200) == []


def test_relays_that_cannot_be_so_fast_refuse(make_rig: MakeRig) -> None:
    rig = armed(make_rig(loaded=loaded_with(board="feetthrough-relay")))
    refused = rig.show(current_ua=only(N, e3=50))
    assert refused.error == "board_cannot"
    assert refused.reason is not None
    assert "2857 us" in refused.reason


def test_so_many_pulses_per_electrode_then_silence_counts_them_one_by_one(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(loaded=loaded_with()), 1_000)
    rig.run_ms(300)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=(800,) * N, pulses=8, ttl_ms=900)
    rig.run_ms(300)
    found = phases(rig, since_ns)
    assert [len(begun_us(found, electrode)) for electrode in range(N)] == [8] * N


def test_a_frame_that_expires_within_a_burst_ends_it(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=loaded_with()), 1_000)
    rig.run_ms(300)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=800), ttl_ms=7)
    rig.run_ms(100)
    begun = begun_us(phases(rig, since_ns), 3)
    assert 2 <= len(begun) <= 3
    assert begun[-1] * 1_000 - since_ns < 8 * MS


def test_a_stop_within_a_burst_is_heard_between_its_pulses(make_rig: MakeRig) -> None:
    loaded = loaded_with(Bursts(pulses=2, rate_hz=50.0), "reference-hv507")
    rig = fully_open(make_rig(loaded=loaded), 500)
    rig.run_ms(300)
    rig.show(current_ua=only(N, e3=400), rate_hz=2.0, ttl_ms=1_000)
    now_ns = rig.clock.now_ns()
    rig.fake.world.press("emergency_stop", now_ns + 10 * MS)
    rig.run_ms(100)
    assert rig.state == "HALTED"
    off_ns = [t_ns for t_ns, level in moves(rig, "HV", now_ns) if not level]
    assert now_ns + 10 * MS <= off_ns[0] < now_ns + 13 * MS
    after = [phase.from_ns for phase in phases(rig, now_ns) if phase.from_ns > now_ns + 10 * MS]
    assert after == []


# --- limits ---------------------------------------------------------------------------------------


def test_the_ledger_counts_every_pulse_of_a_burst(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=loaded_with(on_us_per_s=4_000)), 1_000)
    rig.run_ms(870)
    since_ns = rig.clock.now_ns()
    rig.hold(900, current_ua=only(N, e3=800), width_us=100)
    assert len(begun_us(phases(rig, since_ns), 3)) == 40
    told = [
        shortfall
        for scan in scans(rig)
        for shortfall in scan.not_fired
        if shortfall.reason == "ledger"
    ]
    assert 3 in {shortfall.electrode for shortfall in told}


def test_bursts_whose_pulses_are_too_many_in_a_second_are_refused() -> None:
    refused = refusal_of(current_ua=currents(e3=800), rate_hz=21.0)
    assert refused.code == "over_maximum"
    assert "rate 126 Hz" in refused.reason


def test_the_mean_current_is_that_of_all_pulses_of_a_burst() -> None:
    """3.4 mA for 100 us, six times 15 a second: 30.6 uA."""
    made = planner(site=bursting(body_site()), caps_ua=(8_000,) * N)
    assert made.plan(frame(current_ua=currents(e3=3_300), width_us=100)).pulses == 6
    refused = refusal_of(current_ua=currents(e3=3_400), width_us=100)
    assert "mean current 30.6 uA" in refused.reason


def test_the_mean_of_the_array_is_that_of_all_pulses_of_a_burst() -> None:
    made = planner(site=bursting(body_site(), array_mean_current_ua=100))
    with pytest.raises(Refused, match="mean current would be 115 uA"):
        made.plan(frame(current_ua=(800,) * N, width_us=100))


def test_a_rate_of_bursts_that_does_not_fit_is_refused_with_the_achievable_one() -> None:
    """64 electrodes make 8 groups of 5 intervals and a round each: 137 ms, and a rewriting."""
    made = planner(site=bursting(body_site()), layout=array("grid-8x8"))
    with pytest.raises(Refused, match="do not fit") as caught:
        made.plan(frame(current_ua=(500,) * 64, width_us=100, rate_hz=15.0))
    assert caught.value.achievable_hz == pytest.approx(6.9, abs=0.1)
    shortfalls = made.plan(
        frame(current_ua=(500,) * 64, width_us=100, rate_hz=15.0, allow_slower=True)
    )
    assert shortfalls.rate_hz == caught.value.achievable_hz
    assert len(shortfalls.groups) == 8


def test_a_burst_takes_its_intervals_however_few_electrodes_there_are() -> None:
    """4 intervals of 20 ms."""
    made = planner(site=bursting(body_site(), Bursts(pulses=5, rate_hz=50.0)))
    with pytest.raises(Refused, match="do not fit") as caught:
        made.plan(frame(current_ua=currents(e3=500), rate_hz=15.0))
    assert caught.value.achievable_hz == pytest.approx(12.2, abs=0.2)


def test_without_bursts_a_scan_is_one_group_of_single_pulses() -> None:
    plan = planner(board=board_file()).plan(frame(current_ua=(500,) * N))
    assert (plan.groups, plan.pulses, plan.interval_ns) == ((tuple(range(N)),), 1, 0)
