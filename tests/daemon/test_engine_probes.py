"""No probe of any kind gives an electrode more than the board's probe bound, or than its person has
accepted: a cap is a current, and the charge that it has in the pulses that it was accepted with.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import msgspec
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import calibration, config, only, open_calibrated, phases
from etd.protocol.link import MeasureContact
from etd.pulse.request import NO_GAIN, SHORTEST_US, PulseRequest
from etd.stabilize.law_settings import ContactSettings
from etd.stabilize.pipeline import ElectrodeEstimate, Stabilizer
from etd.stabilize.settings import Settings
from etd_hal.fake.faults import AdcNoise, Fault
from trace_decoder import Phase, is_led, visits

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
#: Of the board file.
PROBE_UA, PROBE_US = 300, 50
#: The electrode that frames stimulate; all others are looked at.
HERE = 4
ROUNDING_PC = 1.0
MS = 1_000_000


def calibrated(
    caps_ua: tuple[int, ...],
    width_us: int,
    *,
    is_probe_first: bool = True,
    stabilizers: Sequence[Stabilizer] | None = None,
    faults: Sequence[Fault] = (),
    make: Callable[..., EngineRig] = engine_rig.make,
    **maxima: int,
) -> EngineRig:
    """Open with these caps, accepted in pulses of one width; contacts are kept known by looks."""
    loaded = config(electrodes=N, maxima=maxima)
    laws = Settings(order=("contact",), contact=ContactSettings(), probe_first=is_probe_first)
    site = msgspec.structs.replace(loaded.body_site, stabilize=laws)
    rig = make(
        loaded=dataclasses.replace(loaded, body_site=site), stabilizers=stabilizers, faults=faults
    )
    made = calibration(rig, caps_ua, width_us=width_us, rate_hz=20.0, shape=laws.shape)
    answer = open_calibrated(rig, made)
    assert answer.error is None, answer.reason
    return rig


def probes(rig: EngineRig, armed_ns: int) -> Iterator[tuple[str, Phase]]:
    """Each weak pulse that asks who touches, and what kind it is."""
    for visit in visits(phases(rig)):
        first, electrode = visit[0], visit[0].electrode
        assert electrode is not None
        if first.from_ns < armed_ns:
            yield "contact", first
        elif electrode != HERE:
            yield "look", first
        elif len(visit) > 1 and is_led(first, visit[1]):
            yield "first", first


def check_probes(
    rig: EngineRig, armed_ns: int, caps_ua: tuple[int, ...], width_us: int
) -> set[str]:
    """The kinds that there were."""
    kinds = set()
    for kind, probe in probes(rig, armed_ns):
        kinds.add(kind)
        assert probe.electrode is not None
        cap_ua = caps_ua[probe.electrode]
        assert probe.current_ua <= min(PROBE_UA, cap_ua), kind
        assert probe.width_us <= PROBE_US, kind
        assert probe.charge_pc <= cap_ua * width_us + ROUNDING_PC, kind
    return kinds


@settings(max_examples=20, suppress_health_check=[HealthCheck.too_slow])
@given(
    caps_ua=st.tuples(*[st.sampled_from([10, 100, 250, 400, 1_000])] * N),
    accepted_us=st.integers(20, 100),
    frame_us=st.integers(20, 200),
    is_probe_first=st.booleans(),
)
# The one that is stimulated conducts more than all others together, each of which may be the best.
@example(
    caps_ua=tuple(1_000 if electrode == HERE else 10 for electrode in range(N)),
    accepted_us=33,
    frame_us=67,
    is_probe_first=False,
)
def test_no_probe_gives_more_charge_than_was_accepted(
    caps_ua: tuple[int, ...], accepted_us: int, frame_us: int, is_probe_first: bool
) -> None:
    rig = calibrated(caps_ua, accepted_us, is_probe_first=is_probe_first)
    rig.arm()
    armed_ns = rig.clock.now_ns()
    rig.hold(900, current_ua=only(N, e4=1_000), width_us=frame_us, rate_hz=20.0)
    check_probes(rig, armed_ns, caps_ua, accepted_us)
    assert rig.close() == ()


@pytest.mark.parametrize("accepted_us", [20, 35, 50, 100])
def test_each_kind_of_probe_is_within_what_was_accepted(
    make_rig: MakeRig, accepted_us: int
) -> None:
    """A strong frame at an electrode with a high cap, beside electrodes with low ones."""
    caps_ua = tuple(1_000 if electrode == HERE else 250 for electrode in range(N))
    rig = calibrated(caps_ua, accepted_us, is_probe_first=True, make=make_rig)
    rig.arm()
    armed_ns = rig.clock.now_ns()
    rig.hold(900, current_ua=only(N, e4=1_000), width_us=accepted_us, rate_hz=20.0)
    kinds = check_probes(rig, armed_ns, caps_ua, accepted_us)
    assert kinds == {"contact", "look", "first"}


class Narrows:
    """A law that makes every pulse as narrow as can be, at the same current."""

    max_gain = NO_GAIN

    def adapt(self, pulse_request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        return pulse_request.stepped(pulse_request.current_ua, SHORTEST_US)

    def reset(self) -> None:
        pass


def test_a_probe_before_a_wide_pulse_that_a_law_makes_narrow_is_within_what_was_accepted(
    make_rig: MakeRig,
) -> None:
    """The pulse may have its cap's current then, which is above the probe's."""
    caps_ua = (400,) * N
    rig = calibrated(caps_ua, SHORTEST_US, stabilizers=[Narrows()], make=make_rig)
    rig.arm()
    armed_ns = rig.clock.now_ns()
    rig.hold(400, current_ua=only(N, e4=400), width_us=100, rate_hz=20.0)
    assert check_probes(rig, armed_ns, caps_ua, SHORTEST_US) >= {"contact", "first"}


@pytest.mark.parametrize("accepted_us", [20, 30, 40, 50])
def test_a_narrower_probe_tells_what_touches_all_the_same(
    make_rig: MakeRig, accepted_us: int
) -> None:
    """By an ADC as noisy as one in order may be."""
    rig = calibrated(
        (250,) * N, accepted_us, faults=[AdcNoise(1.5, seed=accepted_us)], make=make_rig
    )
    lifted = {2, 7, 11}
    for electrode in lifted:
        rig.fake.world.lift(electrode)
    answer = rig.ask(MeasureContact, lease=LEASE)
    assert answer.contact is not None
    assert answer.contact.contact == tuple(electrode not in lifted for electrode in range(N))


# --- looks are pulses like others: limits and ledger hold for them -------------------------------


def looks(rig: EngineRig, since_ns: int) -> list[Phase]:
    return [phase for phase in phases(rig, since_ns) if phase.electrode != HERE]


def test_a_look_is_not_above_the_ceiling_of_the_opening(make_rig: MakeRig) -> None:
    """Half a milliampere in 100 ms, at the most."""
    rig = calibrated((1_000,) * N, 100, is_probe_first=False, make=make_rig)
    rig.arm()
    rig.run_ms(600)
    since_ns = rig.clock.now_ns()
    rig.hold(150, current_ua=only(N, e4=20), rate_hz=50.0)
    seen = looks(rig, since_ns)
    assert {phase.electrode for phase in seen} == set(range(N)) - {HERE}
    for other_phase in seen:
        assert other_phase.current_ua <= (other_phase.from_ns - since_ns) * 500 / (100 * MS)
    assert min(phase.current_ua for phase in seen) < 0.9 * PROBE_UA


def test_a_look_is_not_above_the_cap_of_a_return_that_may_carry_it_all(make_rig: MakeRig) -> None:
    """As one may when somebody was found gone, and no look from before counts."""
    cap_ua = 60
    caps_ua = tuple(cap_ua if electrode == 9 else 1_000 for electrode in range(N))
    rig = calibrated(caps_ua, 100, is_probe_first=False, make=make_rig)
    rig.arm()
    frame = {"current_ua": only(N, e4=500), "rate_hz": 50.0}
    rig.hold(700, **frame)
    since_ns = rig.clock.now_ns()
    rig.fake.world.lift(3)
    rig.hold(600, **frame)
    seen = looks(rig, since_ns)
    gone = next(place for place, phase in enumerate(seen) if phase.electrode == 3)
    assert seen[gone].current_ua > 0.9 * PROBE_UA
    assert seen[gone + 1].current_ua <= cap_ua


def test_a_look_that_the_second_has_no_room_for_is_not_fired(make_rig: MakeRig) -> None:
    """A frame that takes all the time with current that the array may have."""
    rate_hz, width_us = 20, 100
    rig = calibrated(
        (1_000,) * N,
        width_us,
        make=make_rig,
        is_probe_first=False,
        array_on_us_per_s=rate_hz * width_us,
    )
    rig.arm()
    rig.run_ms(800)
    since_ns = rig.clock.now_ns()
    rig.hold(3_000, current_ua=only(N, e4=500), width_us=width_us, rate_hz=float(rate_hz))
    found = phases(rig, since_ns)
    for last in found:
        second = [phase for phase in found if 0 <= last.from_ns - phase.from_ns < 1_000 * MS]
        assert sum(phase.width_us for phase in second) <= rate_hz * width_us
    assert looks(rig, since_ns)
