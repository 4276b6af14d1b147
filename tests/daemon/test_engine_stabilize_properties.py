"""Whatever the samples say and the skin does: no law gets more than the limits, the opening and the
frame's own most, and a weaker frame is weaker with its first pulse.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_scenes import armed, phases
from etd.config import LoadedConfig, fake_config
from etd.stabilize.contact import ContactLaw
from etd.stabilize.energy import EnergyLaw
from etd.stabilize.fitted import FittedLaw
from etd.stabilize.lines import LinesLaw
from etd.stabilize.pressure import PressureLaw
from etd.stabilize.settings import Settings
from etd_body.electrode import OPEN_CONTACT, Contact, skin
from etd_hal.fake.faults import AdcScale, Fault

N = 8
CAP_UA = 2_000
WIDER = 1.5
PROBE_PC = 300 * 50
RISE_UA, RISE_NS = 50, 10_000_000
LAWS: dict[str, dict[str, Any]] = {
    "energy": {"pressure": PressureLaw(), "energy": EnergyLaw(), "contact": ContactLaw()},
    "fitted": {"fitted": FittedLaw(k=2.0), "contact": ContactLaw()},
    "fitted the other way": {"fitted": FittedLaw(k=-2.0, rise_per_s=20.0)},
    "lines": {"lines": LinesLaw(rise_per_s=20.0), "contact": ContactLaw()},
    "energy, a probe first": {"energy": EnergyLaw(rise_per_s=20.0), "contact": ContactLaw()},
    "lines, a probe first": {"lines": LinesLaw(charge_slope=1.0, energy_slope=2.0)},
}


def loaded_with(laws: dict[str, Any], is_probe_first: bool = False) -> LoadedConfig:
    loaded = fake_config(electrodes=N)
    table = Settings(order=tuple(laws), probe_first=is_probe_first, **laws)  # type: ignore[arg-type]
    return replace(loaded, body_site=msgspec.structs.replace(loaded.body_site, stabilize=table))


contacts = st.one_of(
    st.just(OPEN_CONTACT),
    st.builds(skin, st.floats(100, 5_000), st.floats(500, 400_000), st.floats(0.05, 3.0)),
)
happenings = st.one_of(
    st.tuples(st.integers(0, N - 1), contacts),
    st.sampled_from([0.0, 0.02, 0.5, 2.0, 30.0]).map(AdcScale),
    st.none(),
)
frames = st.tuples(
    st.tuples(*[st.sampled_from([0, 50, 900, 2_000, 3_000])] * N),
    st.sampled_from([20, 40, 100, 150]),
    st.integers(20, 150),
)


@pytest.mark.parametrize("name", LAWS)
@settings(
    deadline=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(story=st.lists(st.tuples(frames, happenings), min_size=2, max_size=5))
def test_no_law_gets_more_whatever_it_is_told(
    name: str,
    story: list[tuple[tuple[tuple[int, ...], int, int], tuple[int, Contact] | Fault | None]],
) -> None:
    loaded = loaded_with(LAWS[name], is_probe_first="a probe first" in name)
    rig = armed(engine_rig.make(loaded=loaded), CAP_UA)
    armed_ns = rig.clock.now_ns()
    shown: dict[int, tuple[tuple[int, ...], int]] = {}
    faults: list[Fault] = []
    for (current_ua, width_us, duration_ms), happening in story:
        if isinstance(happening, tuple):
            rig.fake.world.touch(*happening)
        elif happening is not None and happening not in faults:
            rig.fake.world.put_in(happening)
            faults.append(happening)
        elif faults:
            rig.fake.world.take_out(faults.pop())
        answer = rig.show(current_ua=current_ua, width_us=width_us, rate_hz=40.0, ttl_ms=1_000)
        if answer.error is None:
            shown[rig.last_seq] = (current_ua, width_us)
        rig.run_ms(duration_ms)
    for phase in phases(rig, armed_ns):
        assert phase.seq is not None
        assert phase.electrode is not None
        current_ua, width_us = shown[phase.seq]
        if current_ua[phase.electrode] == 0:
            assert phase.current_ua * phase.width_us <= PROBE_PC, "no look is stronger than a probe"
            continue
        wanted_pc = current_ua[phase.electrode] * width_us
        assert phase.charge_pc <= WIDER * wanted_pc + 1.0
        assert phase.charge_pc <= CAP_UA * width_us + 1.0
        assert phase.current_ua <= min(CAP_UA, current_ua[phase.electrode])
        assert phase.width_us <= WIDER * width_us
        opened_ua = RISE_UA * ((phase.from_ns - armed_ns) // RISE_NS + 1)
        assert phase.current_ua <= opened_ua
    assert rig.close() == ()
