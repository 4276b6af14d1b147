"""The same energy with every pulse: what the law asks for, and what it never asks for."""

from __future__ import annotations

import pytest

from etd.pulse.request import PulseRequest
from etd.stabilize.energy import Energy
from etd.stabilize.law_settings import EnergySettings
from etd.stabilize.pipeline import ElectrodeEstimate

LEAK_OHM = 66_000.0
MS = 1_000_000
FRAME = PulseRequest(2_000, 100)


def energy(**law: float) -> Energy:
    return Energy(EnergySettings(**{"max_widening": 2.0, **law}), LEAK_OHM)  # type: ignore[arg-type]


def known(
    skin_ohm: float | None, now_ms: int = 0, reference_ohm: int | None = 50_000
) -> ElectrodeEstimate:
    return ElectrodeEstimate(
        electrode=3,
        now_ns=now_ms * MS,
        state="closed",
        skin_ohm=skin_ohm,
        skin_at_ua=2_000,
        reference_ohm=reference_ohm,
    )


def joule(pulse_request: PulseRequest, skin_ohm: float) -> float:
    """Into the skin, beside the leak."""
    through_a = pulse_request.current_ua / 1e6 * LEAK_OHM / (LEAK_OHM + skin_ohm)
    return through_a**2 * skin_ohm * pulse_request.width_us / 1e6


def settled(law: Energy, skin_ohm: float, pulse_request: PulseRequest = FRAME) -> PulseRequest:
    """After time enough for any rise."""
    for step in range(30):
        asked = law.adapt(pulse_request, known(skin_ohm, 100 * step))
    return asked


@pytest.mark.parametrize("skin_ohm", [15_000, 25_000, 50_000, 66_000])
def test_the_energy_is_the_references_whatever_the_skin_resists(skin_ohm: int) -> None:
    asked = settled(energy(), skin_ohm)
    assert joule(asked, skin_ohm) == pytest.approx(joule(FRAME, 50_000), rel=0.01)


@pytest.mark.parametrize("skin_ohm", [90_000, 250_000, 2_000_000])
def test_a_skin_above_the_leaks_resistance_is_not_answered_by_more(skin_ohm: int) -> None:
    """It takes less power, because the leak takes more of the current."""
    assert settled(energy(), skin_ohm) == settled(energy(), 66_000)


def test_at_the_reference_nothing_changes() -> None:
    assert settled(energy(), 50_000) == FRAME


def test_a_resistance_that_takes_more_shortens_the_pulse_at_once() -> None:
    law = energy()
    # Far below the leak most power is taken at most resistance.
    settled(law, 10_000)
    assert law.adapt(FRAME, known(60_000, 3_000)).width_us <= 100


def test_a_longer_pulse_comes_slowly() -> None:
    law = energy(rise_per_s=1.0)
    assert law.adapt(FRAME, known(12_000, 0)) == FRAME
    after = law.adapt(FRAME, known(12_000, 100))
    assert 100 < after.width_us <= 110


def test_a_pulse_is_not_shorter_than_the_narrowest_but_weaker() -> None:
    pulse_request = PulseRequest(2_000, 40)
    asked = settled(Energy(EnergySettings(), 1e9), 200_000, pulse_request)
    assert asked.width_us == 35
    assert asked.current_ua == pytest.approx(2_000 * (40 * 50 / 200 / 35) ** 0.5, abs=1)


def test_without_a_believed_resistance_the_pulse_is_the_frames() -> None:
    assert settled(energy(), None) == FRAME  # type: ignore[arg-type]


def test_without_a_calibration_the_first_resistance_at_the_wanted_current_is_the_reference() -> (
    None
):
    law = energy()
    weak = known(80_000, 0, None)
    assert law.adapt(PulseRequest(4_000, 100), weak) == PulseRequest(4_000, 100), (
        "a ramp's pulse is none"
    )
    assert law.adapt(FRAME, known(40_000, 0, None)) == FRAME
    assert law.adapt(FRAME, known(80_000, 10, None)).width_us <= 100
    assert joule(law.adapt(FRAME, known(80_000, 20, None)), 80_000) == pytest.approx(
        joule(FRAME, 40_000), rel=0.01
    )
