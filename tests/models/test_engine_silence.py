"""After a silence, whatever happened to the skin meanwhile: the first pulse, on the wires."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import fully_open, only, phases
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.link import KeepLease
from etd.pulse.measured import MAX_AGE_NS
from etd.stabilize.law_settings import (
    ContactSettings,
    EnergySettings,
    LinearLawSettings,
    PowerLawSettings,
)
from etd.stabilize.settings import Settings
from etd_body.electrode import OPEN_CONTACT, Contact, skin
from trace_decoder import Phase, visits

MakeRig = Callable[..., EngineRig]
N = 16
CURRENT_UA, WIDTH_US, RATE_HZ = 1_500, 60, 50.0
WHOLE, HALF = skin(1_000.0, 19_000.0, 0.8), skin(2_000.0, 38_000.0, 0.4)
BELIEVED_MS = MAX_AGE_NS / 1e6
#: Of the wanted current, where no calibration names a threshold.
START_PART = ContactSettings().start_fraction
LAWS: dict[str, dict[str, Any]] = {
    "contact": {"contact": ContactSettings()},
    "energy": {"energy": EnergySettings(rise_per_s=20.0)},
    "contact, fitted": {
        "contact": ContactSettings(),
        "power_law": PowerLawSettings(rise_per_s=20.0),
    },
    "fitted, weakly": {"power_law": PowerLawSettings(rise_per_s=20.0)},
    "contact, lines": {
        "contact": ContactSettings(),
        "linear_law": LinearLawSettings(rise_per_s=20.0),
    },
}


def with_laws(laws: dict[str, Any], is_probe_first: bool = False) -> LoadedConfig:
    loaded = fake_config(electrodes=N)
    table = Settings(order=tuple(laws), probe_first=is_probe_first, **laws)  # type: ignore[arg-type]
    return replace(loaded, body_site=msgspec.structs.replace(loaded.body_site, stabilize=table))


def standing(rig: EngineRig, k: float = 0.7) -> EngineRig:
    """Electrode 4 well in contact, its frame up for half a second."""
    rig.fake.world.touch(4, WHOLE)
    fully_open(rig, CURRENT_UA, k)
    hold(rig, 1_200)
    return rig


def hold(rig: EngineRig, duration_ms: float, rate_hz: float = RATE_HZ) -> Sequence[Sequence[Phase]]:
    """The visits of electrode 4 meanwhile."""
    since_ns = rig.clock.now_ns()
    rig.hold(duration_ms, current_ua=only(N, e4=CURRENT_UA), width_us=WIDTH_US, rate_hz=rate_hz)
    return list(visits([phase for phase in phases(rig, since_ns) if phase.electrode == 4]))


def silent(rig: EngineRig, duration_ms: float) -> None:
    """No frame stands; the lease is kept."""
    until_ns = rig.clock.now_ns() + int(duration_ms * 1e6)
    rig.engine.components.active.silence()
    while (left_ns := until_ns - rig.clock.now_ns()) > 0:
        assert rig.ask(KeepLease, lease=LEASE).error is None
        rig.run_ms(min(400.0, left_ns / 1e6))


def charge_pc(visit: Sequence[Phase]) -> float:
    """Of its pulse alone."""
    return visit[-1].charge_pc


contacts = st.one_of(
    st.just(OPEN_CONTACT),
    st.builds(skin, st.floats(500, 5_000), st.floats(500, 400_000), st.floats(0.05, 3.0)),
)


@pytest.mark.parametrize("name", LAWS)
@settings(
    deadline=None,
    max_examples=12,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(
    before=contacts,
    meanwhile=st.lists(contacts, max_size=3),
    silence_ms=st.floats(BELIEVED_MS, 3_500.0),
)
def test_the_first_pulse_after_a_silence_is_never_above_the_unstabilized_soft_start(
    name: str, before: Contact, meanwhile: list[Contact], silence_ms: float
) -> None:
    k = 0.4 if "weakly" in name else 0.73
    rig = standing(engine_rig.make(loaded=with_laws(LAWS[name])), k)
    rig.fake.world.touch(4, before)
    hold(rig, 300)
    each_ms = silence_ms / (len(meanwhile) + 1)
    for contact in meanwhile:
        silent(rig, each_ms)
        rig.fake.world.touch(4, contact)
    silent(rig, each_ms)
    first = hold(rig, 15)[0]
    soft = START_PART if "contact" in LAWS[name] else 1.0
    assert charge_pc(first) <= soft * CURRENT_UA * WIDTH_US + 1.0
    assert rig.close() == ()


@pytest.mark.parametrize(("silence_ms", "is_known"), [(700, True), (1_300, False)])
def test_a_factor_and_a_resistance_hold_over_a_short_silence_and_not_over_a_long_one(
    make_rig: MakeRig, silence_ms: int, is_known: bool
) -> None:
    rig = standing(make_rig(loaded=with_laws({"energy": EnergySettings(rise_per_s=20.0)})))
    rig.fake.world.touch(4, skin(500.0, 7_000.0, 1.6))
    hold(rig, 300)
    steady = hold(rig, 30)[-1][-1]
    assert steady.width_us > 1.2 * WIDTH_US
    silent(rig, silence_ms)
    now_ns = rig.clock.now_ns()
    assert (rig.engine.components.adapter.estimate(4, now_ns).skin_ohm is not None) == is_known
    first = hold(rig, 15)[0][-1]
    expected_us = steady.width_us if is_known else WIDTH_US
    assert first.width_us == pytest.approx(expected_us, abs=2)
    assert rig.engine.components.reporter.counters["rejected_old"] == (0 if is_known else 1)


def test_a_finger_put_back_in_a_silence_is_met_softly_and_becomes_firm(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_laws({"contact": ContactSettings()})))
    assert hold(rig, 15)[0][-1].current_ua == pytest.approx(CURRENT_UA, abs=5)
    rig.fake.world.lift(4)
    silent(rig, 1_500)
    rig.fake.world.touch(4, WHOLE)
    found = [sequence[-1].current_ua for sequence in hold(rig, 1_300)]
    assert found[0] == pytest.approx(START_PART * CURRENT_UA, abs=5)
    assert found == sorted(found)
    assert found[-1] == pytest.approx(CURRENT_UA, abs=5)


def test_pulses_slower_than_what_is_believed_are_each_a_first_one(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_laws({"contact": ContactSettings()})))
    silent(rig, 1_100)
    found = hold(rig, 5_000, rate_hz=0.8)
    assert len(found) >= 3
    for (phase,) in found:
        assert phase.current_ua == pytest.approx(START_PART * CURRENT_UA, abs=5)


# --- with a probe first -------------------------------------------------------------------------


def test_a_probe_that_sees_the_same_contact_makes_a_soft_start_needless(make_rig: MakeRig) -> None:
    laws = {"contact": ContactSettings(), "power_law": PowerLawSettings()}
    rig = standing(make_rig(loaded=with_laws(laws, is_probe_first=True)))
    silent(rig, 5_000)
    assert rig.engine.components.adapter.estimate(4, rig.clock.now_ns()).state == "unknown"
    first = hold(rig, 15)[0]
    assert len(first) == 2
    assert charge_pc(first) == pytest.approx(CURRENT_UA * WIDTH_US, rel=0.03)


def test_a_probe_that_sees_half_of_the_contact_makes_the_first_pulse_soft(
    make_rig: MakeRig,
) -> None:
    rig = standing(make_rig(loaded=with_laws({"contact": ContactSettings()}, is_probe_first=True)))
    rig.fake.world.lift(4)
    silent(rig, 1_500)
    rig.fake.world.touch(4, HALF)
    first = hold(rig, 15)[0]
    assert len(first) == 2
    assert charge_pc(first) <= START_PART * CURRENT_UA * WIDTH_US + 1.0


def test_a_probe_that_sees_nothing_leaves_nothing_for_the_first_pulse(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_laws({"contact": ContactSettings()}, is_probe_first=True)))
    silent(rig, 1_500)
    rig.fake.world.lift(4)
    assert len(hold(rig, 15)[0]) == 1


def test_a_resistance_that_a_probe_sees_risen_counts_from_the_first_pulse_on(
    make_rig: MakeRig,
) -> None:
    laws = {"power_law": PowerLawSettings()}
    rig = standing(make_rig(loaded=with_laws(laws, is_probe_first=True)))
    silent(rig, 1_500)
    rig.fake.world.touch(4, HALF)
    assert charge_pc(hold(rig, 15)[0]) < 0.8 * CURRENT_UA * WIDTH_US


# --- kept known by looks ------------------------------------------------------------------------


def test_looks_at_a_silent_electrode_keep_its_contact_known(make_rig: MakeRig) -> None:
    """Another electrode's frame stands meanwhile."""
    rig = standing(make_rig(loaded=with_laws({"contact": ContactSettings()})))
    since_ns = rig.clock.now_ns()
    rig.hold(2_000, current_ua=only(N, e9=900), width_us=WIDTH_US, rate_hz=RATE_HZ)
    looks = [phase for phase in phases(rig, since_ns) if phase.electrode == 4]
    assert 3 <= len(looks) <= 5
    assert max(phase.current_ua for phase in looks) <= 300
    assert rig.engine.components.reporter.counters["not_fired_overrun"] == 0
    assert hold(rig, 15)[0][-1].current_ua == pytest.approx(CURRENT_UA, abs=5)


def test_a_finger_that_looks_saw_come_back_is_met_softly(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_laws({"contact": ContactSettings()})))
    other = {"current_ua": only(N, e9=900), "width_us": WIDTH_US, "rate_hz": RATE_HZ}
    rig.fake.world.lift(4)
    rig.hold(1_500, **other)
    rig.fake.world.touch(4, WHOLE)
    rig.hold(500, **other)
    assert hold(rig, 100)[0][-1].current_ua < START_PART * CURRENT_UA


@pytest.mark.parametrize("laws", [{}, {"power_law": PowerLawSettings()}])
def test_nobody_is_looked_at_for_laws_that_do_not_go_by_contact(
    make_rig: MakeRig, laws: dict[str, Any]
) -> None:
    rig = standing(make_rig(loaded=with_laws(laws)))
    rig.hold(1_500, current_ua=only(N, e9=900), width_us=WIDTH_US, rate_hz=RATE_HZ)
    assert rig.engine.components.reporter.counters["contact_polls"] == 0
