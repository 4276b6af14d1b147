"""An ADC whose gain or offset is another one: no law stands at the most that it may ask for.

On a board whose probes are too weak to check the source with: elsewhere such a gain halts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import pytest

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import fully_open, only, phases, unchecked
from etd.files.configuration import fake_config
from etd.protocol.link import CloseLease
from etd.stabilize.law_settings import EnergySettings, LinearLawSettings, PowerLawSettings
from etd.stabilize.settings import Settings
from etd_body.electrode import skin
from etd_hal.fake.faults import AdcScale

N, WIDTH_US, CURRENT_UA = 16, 60, 1_000
NEAR = 1.5**0.8
LAWS: dict[str, Any] = {
    "power_law": PowerLawSettings(),
    "energy": EnergySettings(),
    "linear_law": LinearLawSettings(charge_slope=-0.48, energy_slope=0.22),
}


def rig_with(name: str) -> EngineRig:
    """One dry fingertip under electrode 4, which the law has taken for its reference."""
    loaded = fake_config(electrodes=N)
    table = Settings(order=(name,), **{name: LAWS[name]})  # type: ignore[arg-type]
    loaded = replace(loaded, body_site=msgspec.structs.replace(loaded.body_site, stabilize=table))
    rig = engine_rig.make(loaded=unchecked(loaded))
    assert rig.engine.components.source_check.limitations
    rig.fake.world.touch(4, skin(1_000.0, 19_000.0, 0.8))
    fully_open(rig, 1_500, k=1.05)
    held(rig, 1_300)
    return rig


def held(rig: EngineRig, duration_ms: float) -> float:
    """The charge of the last pulse then, as a multiple of the frame's."""
    begun_ns = rig.clock.now_ns()
    wanted = only(N, e4=CURRENT_UA)
    rig.hold(duration_ms, current_ua=wanted, width_us=WIDTH_US, rate_hz=10.0, ttl_ms=300)
    last = [phase for phase in phases(rig, begun_ns) if phase.electrode == 4][-1]
    return last.charge_pc / (CURRENT_UA * WIDTH_US)


def doubts(rig: EngineRig) -> int:
    return rig.engine.components.reporter.counters["rejected_bound"]


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("gain", [0.5, 0.6, 0.7, 0.85, 1.2, 2.0])
def test_a_law_that_a_wrong_gain_holds_at_its_widest_gives_up_and_says_so_once(
    name: str, gain: float
) -> None:
    rig = rig_with(name)
    rig.fake.world.put_in(AdcScale(gain))
    at_first = held(rig, 3_000)
    assert doubts(rig) == 0, "skin may ask for that, for a while"
    at_last = held(rig, 9_000)
    if at_first < NEAR:
        assert at_last == pytest.approx(at_first, rel=0.03)
        assert doubts(rig) == 0
    else:
        assert at_last == pytest.approx(1.0, abs=0.02)
        assert doubts(rig) == 1
    assert at_last < NEAR
    assert rig.close() == ()


@pytest.mark.parametrize("gain", [2.3, 2.5])
def test_a_law_that_a_gain_too_high_holds_at_next_to_nothing_stays_there_and_says_so_once(
    gain: float,
) -> None:
    rig = rig_with("power_law")
    rig.fake.world.put_in(AdcScale(gain))
    assert held(rig, 3_000) < 0.25, "skin may ask for that, for a while"
    assert held(rig, 18_000) < 0.25, "an edge of skin that carries all reads the same"
    assert rig.engine.components.reporter.counters["rejected_narrow"] == 1
    assert rig.close() == ()


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("gain", [2.3, 2.9, 3.5, 4.0])
def test_no_law_is_driven_above_what_the_frame_wants_by_a_resistance_too_high(
    name: str, gain: float
) -> None:
    rig = rig_with(name)
    rig.fake.world.put_in(AdcScale(gain))
    assert held(rig, 3_000) <= 1.0
    assert rig.close() == ()


def test_some_gains_do_hold_a_law_at_its_widest() -> None:
    """What the test above is about."""
    rig = rig_with("power_law")
    rig.fake.world.put_in(AdcScale(0.6))
    assert held(rig, 2_000) > 1.45
    rig.close()


def test_whoever_comes_next_is_told_what_is_still_not_believed() -> None:
    rig = rig_with("power_law")
    rig.fake.world.put_in(AdcScale(0.6))
    held(rig, 12_000)
    assert doubts(rig) == 1
    rig.ask(CloseLease, lease=LEASE)
    fully_open(rig, 1_500, k=1.05)
    assert held(rig, 12_000) == pytest.approx(1.0, abs=0.02)
    assert doubts(rig) == 2
    assert rig.close() == ()


def test_a_gain_that_is_right_now_and_then_is_not_believed_for_the_rest_of_the_time() -> None:
    rig = rig_with("power_law")
    wrong = AdcScale(0.6)
    for _ in range(2):
        rig.fake.world.put_in(wrong)
        held(rig, 8_500)
        rig.fake.world.take_out(wrong)
        held(rig, 250)
    assert doubts(rig) == 1
    rig.close()


def test_a_law_is_believed_again_when_it_wants_less() -> None:
    rig = rig_with("power_law")
    wrong = AdcScale(0.6)
    rig.fake.world.put_in(wrong)
    held(rig, 12_000)
    assert doubts(rig) == 1
    rig.fake.world.take_out(wrong)
    held(rig, 11_000)
    rig.fake.world.touch(4, skin(1_000.0, 15_000.0, 1.0))
    assert held(rig, 1_000) > 1.1
    assert rig.close() == ()


@pytest.mark.parametrize("name", LAWS)
def test_a_gain_that_is_wrong_for_all_electrodes_widens_none_for_long(name: str) -> None:
    rig = rig_with(name)
    ohms = {1: 15_000.0, 3: 25_000.0, 4: 19_000.0, 6: 22_000.0}
    for electrode, ohm in ohms.items():
        rig.fake.world.touch(electrode, skin(1_000.0, ohm, 0.8))
    wanted = only(N, **{f"e{ohm}": CURRENT_UA for ohm in ohms})

    def charges(duration_ms: float) -> dict[int, float]:
        begun_ns = rig.clock.now_ns()
        rig.hold(duration_ms, current_ua=wanted, width_us=WIDTH_US, rate_hz=10.0, ttl_ms=300)
        last = {phase.electrode: phase.charge_pc for phase in phases(rig, begun_ns)}
        return {ohm: last[ohm] / (CURRENT_UA * WIDTH_US) for ohm in ohms}

    assert max(charges(2_500).values()) < 1.1
    rig.fake.world.put_in(AdcScale(0.7))
    assert max(charges(500).values()) > (1.01 if name == "linear_law" else 1.2)
    left = charges(25_000)
    assert max(left.values()) < 1.15
    rig.fake.world.touch(3, skin(1_000.0, 0.6 * ohms[3], 0.8))
    more = 0.0 if name == "linear_law" else 0.1
    assert charges(1_000)[3] >= left[3] + more, "one that alone gets wetter is still answered"
    assert doubts(rig) == 0
    assert rig.engine.components.reporter.counters["rejected_common"] == (
        0 if name == "linear_law" else 1
    )
    assert rig.close() == ()
