"""The laws that go by resistance, held to what is common to them and to their own formulas."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.protocol.messages import ContactState
from etd.pulse.measured import BEND_UA
from etd.pulse.request import PulseRequest
from etd.stabilize.energy import Energy
from etd.stabilize.law_settings import EnergySettings, LinearLawSettings, PowerLawSettings
from etd.stabilize.linear_law import LinearLaw
from etd.stabilize.pipeline import ElectrodeEstimate, Stabilizer
from etd.stabilize.power_law import PowerLaw
from plain_records import changed

pytestmark = pytest.mark.slow

LEAK_OHM = 66_000.0
MS = 1_000_000
FRAME = PulseRequest(2_000, 100)


class Worn:
    """Implements `Stabilizer`: the law, by a person with this k."""

    def __init__(self, k: float, max_widening: float = 1.5) -> None:
        self._law = PowerLaw(PowerLawSettings(max_widening=max_widening))
        self._k = k
        self.max_gain = self._law.max_gain

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        return self._law.adapt(request, changed(estimate, exponent=self._k))

    def reset(self) -> None:
        self._law.reset()


LAWS: dict[str, Callable[[], Stabilizer]] = {
    "energy": lambda: Energy(EnergySettings(max_widening=2.0), LEAK_OHM),
    "power_law": lambda: Worn(1.0, max_widening=2.0),
    "fitted the other way": lambda: Worn(-0.5),
    "linear_law": lambda: LinearLaw(LinearLawSettings(max_widening=2.0), LEAK_OHM),
    "steep lines": lambda: LinearLaw(
        LinearLawSettings(charge_slope=-0.8, energy_slope=0.4, max_widening=2.0), LEAK_OHM
    ),
}
every_law = pytest.mark.parametrize("make", LAWS.values(), ids=LAWS.keys())


def known(
    skin_ohm: float | None,
    now_ms: int = 0,
    state: ContactState = "closed",
    reference_at_ua: int | None = None,
) -> ElectrodeEstimate:
    return ElectrodeEstimate(
        electrode=3,
        now_ns=now_ms * MS,
        state=state,
        skin_ohm=skin_ohm,
        skin_at_ua=2_000,
        reference_ohm=50_000,
        reference_at_ua=reference_at_ua,
    )


def settled(
    law: Stabilizer, skin_ohm: float | None, pulse_request: PulseRequest = FRAME
) -> PulseRequest:
    """After time enough for any rise."""
    for step in range(30):
        asked = law.adapt(pulse_request, known(skin_ohm, 100 * step))
    return asked


def delivered_nc(pulse_request: PulseRequest, skin_ohm: float) -> float:
    return (
        pulse_request.current_ua * pulse_request.width_us / 1_000 * LEAK_OHM / (LEAK_OHM + skin_ohm)
    )


@every_law
def test_at_the_reference_nothing_changes(make: Callable[[], Stabilizer]) -> None:
    assert settled(make(), 50_000.0) == FRAME


@every_law
def test_without_a_believed_resistance_the_pulse_is_what_was_wanted(
    make: Callable[[], Stabilizer],
) -> None:
    assert settled(make(), None) == FRAME


@every_law
@pytest.mark.parametrize("skin_ohm", [2_000.0, 20_000.0, 120_000.0, 1e6])
def test_a_soft_contact_gets_no_more_than_what_was_wanted(
    make: Callable[[], Stabilizer], skin_ohm: float
) -> None:
    law = make()
    for step in range(30):
        asked = law.adapt(FRAME, known(skin_ohm, 100 * step, "soft"))
    assert asked.current_ua * asked.width_us <= FRAME.current_ua * FRAME.width_us


@every_law
@given(
    skin=st.lists(st.one_of(st.none(), st.floats(1e3, 2e6)), min_size=1, max_size=20),
    pulses=st.lists(
        st.tuples(st.integers(0, 10_000), st.integers(20, 200)), min_size=20, max_size=20
    ),
    pause_ms=st.integers(0, 3_000),
)
def test_whatever_is_measured_it_stays_within_its_reach(
    make: Callable[[], Stabilizer],
    skin: list[float | None],
    pulses: list[tuple[int, int]],
    pause_ms: int,
) -> None:
    law = make()
    for step, (skin_ohm, (current_ua, width_us)) in enumerate(zip(skin, pulses, strict=False)):
        asked = law.adapt(PulseRequest(current_ua, width_us), known(skin_ohm, pause_ms * step))
        assert asked.is_possible
        assert asked.current_ua <= current_ua * law.max_gain.current
        assert asked.width_us <= width_us * law.max_gain.width
        most = current_ua * width_us * law.max_gain.charge
        assert asked.current_ua * asked.width_us <= most * (1 + 1e-9)


@every_law
def test_a_fall_is_never_delayed_and_a_rise_takes_time(make: Callable[[], Stabilizer]) -> None:
    for less_ohm, more_ohm in ((12_000.0, 90_000.0), (90_000.0, 12_000.0)):
        law = make()
        before = settled(law, less_ohm)
        at_once = law.adapt(FRAME, known(more_ohm, 2_910))
        after = settled(make(), more_ohm)
        if after.current_ua * after.width_us <= before.current_ua * before.width_us:
            assert at_once == after
        else:
            risen = at_once.current_ua * at_once.width_us - before.current_ua * before.width_us
            assert risen <= 0.02 * FRAME.current_ua * FRAME.width_us


@every_law
@pytest.mark.parametrize("is_early", [False, True], ids=["by the end", "by the beginning"])
@given(mean_ohm=st.floats(5e3, 5e5), ratio=st.floats(0.7, 1.4))
def test_a_mean_over_pulses_delays_no_fall(
    make: Callable[[], Stabilizer], is_early: bool, mean_ohm: float, ratio: float
) -> None:
    """What is asked for is no more than the last pulse alone asks for, nor than the mean does."""

    def asked_by(mean_ohm: float, latest_ohm: float) -> PulseRequest:
        seen = changed(known(mean_ohm), latest_ohm=latest_ohm, is_reference_early=is_early)
        seen = changed(seen, early_ohm=mean_ohm, latest_early_ohm=latest_ohm)
        return make().adapt(FRAME, seen)

    latest_ohm = mean_ohm * ratio
    asked = asked_by(mean_ohm, latest_ohm)
    by_one = [asked_by(ohm, ohm) for ohm in (mean_ohm, latest_ohm)]
    rounded_pc = 2 * asked.width_us
    assert asked.charge_pc <= min(request.charge_pc for request in by_one) + rounded_pc
    assert asked.current_ua <= max(request.current_ua for request in by_one)


@pytest.mark.parametrize(("skin_ohm", "factor"), [(100_000, 0.5), (40_000, 1.25), (10_000, 2.0)])
def test_a_fitted_width_is_a_power_of_the_resistance(skin_ohm: int, factor: float) -> None:
    asked = settled(Worn(1.0, max_widening=2.0), skin_ohm)
    assert asked.current_ua * asked.width_us == pytest.approx(2_000 * 100 * factor, rel=0.01)


@pytest.mark.parametrize("skin_ohm", [10_000.0, 25_000.0, 50_000.0])
def test_lines_with_their_default_slopes_hold_the_delivered_charge(skin_ohm: float) -> None:
    asked = settled(LinearLaw(LinearLawSettings(max_widening=2.0), LEAK_OHM), skin_ohm)
    assert delivered_nc(asked, skin_ohm) == pytest.approx(delivered_nc(FRAME, 50_000), rel=0.01)


@pytest.mark.parametrize("skin_ohm", [51_000.0, 150_000.0, 1_000_000.0])
def test_what_the_leak_takes_where_resistance_rises_is_not_made_up_for(skin_ohm: float) -> None:
    asked = settled(LinearLaw(LinearLawSettings(max_widening=2.0), LEAK_OHM), skin_ohm)
    assert asked.current_ua * asked.width_us <= FRAME.current_ua * FRAME.width_us


def test_lines_solve_for_both_current_and_width() -> None:
    asked = settled(
        LinearLaw(LinearLawSettings(charge_slope=-0.2, energy_slope=0.5), 1e12), 60_000.0
    )
    charge, energy, resistance = 1 - 0.2 * 0.2, 1 + 0.5 * 0.2, 1.2
    assert asked.current_ua == pytest.approx(2_000 * energy / (charge * resistance), rel=0.05)
    assert asked.current_ua * asked.width_us == pytest.approx(2e5 * charge, rel=0.01)
    assert asked.width_us == pytest.approx(100 * charge**2 * resistance / energy, abs=5)


@pytest.mark.parametrize("skin_ohm", [96_000.0, 120_000.0, 1_000_000.0])
def test_no_line_is_followed_below_a_tenth_and_none_turns_there(skin_ohm: float) -> None:
    """At twice the reference it would be at zero, and below it beyond."""
    asked = settled(LinearLaw(LinearLawSettings(charge_slope=-1.0), LEAK_OHM), skin_ohm)
    part = asked.current_ua * asked.width_us / (FRAME.current_ua * FRAME.width_us)
    assert part == pytest.approx(0.1, rel=0.01)


def test_a_reference_is_carried_over_to_the_current_of_the_pulse() -> None:
    law = Worn(1.0, max_widening=2.0)
    eased_ohm = 50_000.0 * (4_000 + BEND_UA) / (2_000 + BEND_UA)
    for step in range(30):
        asked = law.adapt(FRAME, known(eased_ohm, 100 * step, reference_at_ua=4_000))
    assert asked == FRAME


def test_without_a_persons_k_the_pulse_is_what_was_wanted() -> None:
    law = PowerLaw(PowerLawSettings())
    for step in range(30):
        assert law.adapt(FRAME, known(10_000.0, 100 * step)) == FRAME
