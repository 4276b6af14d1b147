"""The k of modelled fingers' own: who gets one by the procedure of a fit, and who is refused."""

from __future__ import annotations

import pytest

from bench.steady_fit_own import own_fit, said, true_k
from etd.calibrate.fitting import STATES
from etd.protocol.exponent import FittedExponent
from etd_body import states
from etd_body.kinds import BodyKind

SEED, ELECTRODES = 31, 8


def test_each_state_that_a_person_is_asked_in_has_a_skin() -> None:
    assert len(states.STATES) == len(STATES)


@pytest.mark.parametrize("kind", [BodyKind.AREA, BodyKind.CAPACITIVE])
def test_where_feeling_follows_the_resistance_it_gives_a_k(kind: BodyKind) -> None:
    found = own_fit(kind, SEED, ELECTRODES)
    assert isinstance(found, FittedExponent)
    assert found.why_not is None
    true = true_k(kind, SEED, ELECTRODES, found.electrodes)
    assert 0.5 < true < 1.4
    assert found.k == pytest.approx(true, rel=0.25)


def test_where_the_leak_alone_follows_the_resistance_it_is_refused() -> None:
    """Its k is known well, and says nothing of the person's skin."""
    found = own_fit(BodyKind.INDIFFERENT, SEED, ELECTRODES)
    assert isinstance(found, FittedExponent)
    assert -0.3 < found.k < found.high < 0.0
    assert "thresholds rise with the resistance" in said(found)


def test_where_sweat_narrows_the_way_in_k_is_below_zero() -> None:
    found = own_fit(BodyKind.DUCTS, SEED, ELECTRODES)
    assert isinstance(found, FittedExponent)
    assert found.high < 0.0


def test_where_damp_skin_hurts_before_it_feels_it_is_refused() -> None:
    assert "refused: " in said(own_fit(BodyKind.TENDER, SEED, ELECTRODES))


def test_nothing_in_it_is_drawn_anew() -> None:
    own_fit.cache_clear()
    first = own_fit(BodyKind.AREA, SEED, ELECTRODES)
    own_fit.cache_clear()
    assert own_fit(BodyKind.AREA, SEED, ELECTRODES) == first
