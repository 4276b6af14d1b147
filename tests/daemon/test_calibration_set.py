"""Calibrations of several polarities in one lease: what they share, and what they allow."""

from __future__ import annotations

import datetime
from typing import Any

import msgspec
import pytest

from calibration_sets import MAXIMA, N, made, person_of, planner_of
from engine_parts import calibration, frame
from etd.protocol.calibration import current_of_level
from etd.protocol.calibration_set import check_together, digest_of
from etd.protocol.errors import Refused
from etd.protocol.frame import POLARITIES, Polarity, Ring
from etd.protocol.messages import Limits
from etd.safety.limits import limits_of_numbers
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.shape import Shape

# --- what belongs together --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"participant": "P02"}, "the participant in common.* P01.* P02.*for one person"),
        ({"array": "pad-8"}, "the array in common"),
        ({"body_site": "forearm"}, "the body site in common"),
        ({"width_us": 80}, "width_us in common: the first one's is 100.*calibrate one of them"),
        ({"rate_hz": 50.0}, "rate_hz in common"),
        ({"returns": Ring(ring_mm=3.0)}, "returns in common"),
        ({"shape": Shape(prepulse=Prepulse(below_db=6.0, width_us=40))}, "the shape of a pulse"),
        ({"electrode": calibration(8).electrode}, "has 16, number 2 has 8"),
        ({"polarity": "anodic"}, "two calibrations .* anodic .*one for each polarity"),
    ],
)
def test_what_does_not_belong_together_is_refused_and_says_why(
    changes: dict[str, Any], said: str
) -> None:
    other = msgspec.structs.replace(made("cathodic"), **changes)
    with pytest.raises(Refused, match=said) as refused:
        check_together((made("anodic"), other))
    assert refused.value.code == "bad_calibration"


def test_what_may_differ_is_the_day_the_method_and_the_curve() -> None:
    other = made("cathodic", gamma=1.5, method="limits", pulses=5, date=datetime.date(2025, 2, 1))
    check_together((made("anodic"), other, made("biphasic"), made("biphasic_cathodic_first")))


def test_a_lease_has_a_calibration_and_at_most_one_for_each_polarity() -> None:
    with pytest.raises(Refused, match="from one to 4"):
        check_together(())
    with pytest.raises(Refused, match="5 calibrations"):
        check_together((*map(made, POLARITIES), made("anodic")))


def test_each_calibration_is_held_against_the_maxima_as_if_it_were_alone() -> None:
    with pytest.raises(Refused, match="electrode 3 has a cap of 9000 uA"):
        person_of(made("anodic"), made("cathodic", (3_000,) * 3 + (9_000,) + (3_000,) * 12))


def test_each_polarity_has_its_own_caps_and_returns_and_probes_the_smallest() -> None:
    anodic = made("anodic", [600 + 10 * n for n in range(N)])
    cathodic = made("cathodic", [700] * N)
    person = person_of(anodic, cathodic)
    assert person.calibrations == (anodic, cathodic)
    assert person.caps_ua == tuple(min(600 + 10 * n, 700) for n in range(N))
    assert person.own_caps_ua == {
        "anodic": tuple(600 + 10 * n for n in range(N)),
        "cathodic": (700,) * N,
    }


def test_one_calibration_caps_every_polarity_alike() -> None:
    anodic = made("anodic", [600 + 10 * n for n in range(N)])
    person = person_of(anodic)
    assert person.calibrations == (anodic,)
    assert person.caps_ua == tuple(600 + 10 * n for n in range(N))
    assert person.own_caps_ua == {}
    assert limits_of_numbers(Limits(max_current_ua=600, width_us=100), MAXIMA, N).calibrations == ()


def test_no_person_has_caps_from_calibrations_that_do_not_belong_together() -> None:
    with pytest.raises(Refused, match=r"two calibrations .* anodic"):
        person_of(made("anodic"), made("anodic", (2_000,) * N))


def test_a_digest_is_of_the_content() -> None:
    assert digest_of(made("anodic")) == digest_of(made("anodic"))
    assert digest_of(made("anodic")) != digest_of(made("cathodic"))


# --- levels and polarities --------------------------------------------------------------------


def test_a_level_is_that_of_the_calibration_of_its_electrodes_polarity() -> None:
    anodic = made("anodic", [300 + 30 * n for n in range(N)])
    cathodic = made("cathodic", [900 + 60 * n for n in range(N)], gamma=2.0)
    kinds: tuple[Polarity, ...] = ("anodic", "cathodic") * 8
    plan = planner_of(anodic, cathodic).plan(frame(level=(0.4,) * N, polarity=kinds))
    assert len(plan.schedule) == N
    for scheduled in plan.schedule:
        own = anodic if scheduled.electrode % 2 == 0 else cathodic
        limits = own.electrode[scheduled.electrode]
        assert scheduled.phases == (own is anodic,)
        assert scheduled.current_ua == current_of_level(limits, 0.4, own.gamma)


@pytest.mark.parametrize("first", ["anodic", "cathodic"])
def test_a_frame_that_names_no_polarity_has_the_first_ones(first: Polarity) -> None:
    second: Polarity = "cathodic" if first == "anodic" else "anodic"
    plan = planner_of(made(first), made(second)).plan(frame(level=(0.5,) * N))
    assert {scheduled.phases for scheduled in plan.schedule} == {(first == "anodic",)}


@pytest.mark.parametrize("wanted", [{"level": (0.5,) * N}, {"current_ua": (100,) * N}])
def test_a_polarity_that_nothing_was_calibrated_with_is_refused(wanted: dict[str, Any]) -> None:
    """By level and by current: no cap is borrowed from another polarity."""
    kinds: tuple[Polarity, ...] = ("anodic",) * 5 + ("biphasic",) + ("cathodic",) * 10
    planner = planner_of(made("anodic"), made("cathodic"))
    with pytest.raises(Refused, match="anodic or cathodic") as refused:
        planner.plan(frame(polarity=kinds, **wanted))
    assert refused.value.code == "bad_frame"
    assert "or send current_ua" not in refused.value.reason, "that would be refused as well"


def test_a_silent_electrodes_polarity_does_not_matter_where_currents_are_named() -> None:
    kinds: tuple[Polarity, ...] = ("biphasic",) + ("anodic",) * 15
    planner = planner_of(made("anodic"), made("cathodic"))
    plan = planner.plan(frame(current_ua=(0, *(100,) * 15), polarity=kinds))
    assert len(plan.schedule) == 15


def test_what_was_not_felt_in_one_polarity_has_levels_in_the_other() -> None:
    anodic = made("anodic")
    unfelt = msgspec.structs.replace(anodic.electrode[4], felt=False)
    electrode = (*anodic.electrode[:4], unfelt, *anodic.electrode[5:])
    planner = planner_of(msgspec.structs.replace(anodic, electrode=electrode), made("cathodic"))
    levels = (0.0,) * 4 + (0.5,) + (0.0,) * 11
    planner.plan(frame(level=levels, polarity="cathodic"))
    with pytest.raises(Refused, match=r"electrode 4 was not felt .*anodic"):
        planner.plan(frame(level=levels, polarity="anodic"))


def test_with_one_calibration_a_level_still_has_its_polarity_only() -> None:
    with pytest.raises(Refused, match=r"with polarity anodic;.* or send current_ua"):
        planner_of(made("anodic")).plan(frame(level=(0.5,) * N, polarity="cathodic"))
