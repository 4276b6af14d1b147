"""A law at its widest or narrowest: when it is given up on an electrode, and what ends that."""

from __future__ import annotations

import pytest

from etd.stabilize.plausibility import Plausibility

MOST = 1.5
WIDEST, NEARLY, BETWEEN, AWAY = MOST, MOST**0.85, MOST**0.65, MOST**0.4
NARROW, RATHER_NARROW, NOT_NARROW = 0.24, 0.4, 0.6
STEP_MS = 100


class Played:
    """One electrode, asked ten times a second."""

    def __init__(self, most: float = MOST) -> None:
        self.told: list[str] = []
        self._trust = Plausibility(most, self.told.append)
        self._now_ms = 0

    def passes(self, seconds: float) -> None:
        """Nobody asks."""
        self._now_ms += round(seconds * 1_000)

    def somebody_else_comes(self) -> None:
        self._trust.report_again()

    def wants(self, factor: float, seconds: float) -> float:
        """What is believed of it at last."""
        believed = factor
        for _ in range(round(seconds * 1_000 / STEP_MS)):
            self._now_ms += STEP_MS
            believed = self._trust.plausible(3, factor, self._now_ms * 1_000_000)
        return believed


def test_it_is_given_up_after_ten_seconds_near_its_widest_and_told_once() -> None:
    played = Played()
    assert played.wants(NEARLY, 10.0) == NEARLY
    assert played.wants(WIDEST, 0.2) == 1.0
    played.wants(WIDEST, 60.0)
    assert played.told == ["bound"]


def test_what_is_not_near_its_widest_is_believed_for_good() -> None:
    played = Played()
    assert played.wants(BETWEEN, 300.0) == BETWEEN
    assert played.told == []


def test_a_want_a_little_below_the_widest_never_ends_a_doubt() -> None:
    """A gain that is a little less wrong is as wrong."""
    played = Played()
    played.wants(WIDEST, 11.0)
    assert played.wants(BETWEEN, 300.0) == 1.0
    assert played.told == ["bound"]


def test_a_doubt_ends_when_clearly_less_was_wanted_for_as_long() -> None:
    played = Played()
    played.wants(WIDEST, 11.0)
    assert played.wants(AWAY, 9.5) == 1.0
    assert played.wants(AWAY, 1.0) == AWAY
    assert played.wants(WIDEST, 9.0) == WIDEST


def test_what_is_wrong_for_more_than_half_of_the_time_is_given_up() -> None:
    played = Played()
    for _ in range(30):
        played.wants(WIDEST, 6.0)
        played.wants(AWAY, 4.0)
    assert played.told == ["bound"]
    assert played.wants(WIDEST, 0.1) == 1.0


def test_pauses_do_not_end_what_leads_to_a_doubt() -> None:
    played = Played()
    for _ in range(3):
        played.wants(WIDEST, 4.0)
        played.passes(30.0)
    assert played.told == ["bound"]


def test_a_site_that_allows_more_than_twice_the_width_is_no_reason_to_believe_it() -> None:
    played = Played(most=4.0)
    assert played.wants(1.7, 60.0) == 1.7
    assert played.wants(1.8, 11.0) == 1.0


def test_time_a_little_below_takes_back_what_leads_to_a_doubt() -> None:
    played = Played()
    for _ in range(20):
        played.wants(WIDEST, 6.0)
        assert played.wants(BETWEEN, 6.0) == BETWEEN
    assert played.told == []


def test_who_is_doubted_still_gets_less_where_less_is_wanted() -> None:
    played = Played()
    played.wants(WIDEST, 11.0)
    assert played.wants(0.7, 0.1) == 0.7


def test_next_to_nothing_for_ten_seconds_is_told_once_and_stays_next_to_nothing() -> None:
    """An edge of skin that carries all would be hurt by what the frame wants."""
    played = Played()
    played.wants(NARROW, 10.0)
    assert played.told == []
    assert played.wants(NARROW, 0.2) == NARROW
    assert played.wants(0.01, 60.0) == 0.01
    assert played.told == ["narrow"]


def test_what_skin_asks_for_when_it_hardly_touches_is_nothing_to_tell() -> None:
    played = Played()
    played.wants(RATHER_NARROW, 300.0)
    assert played.told == []


def test_next_to_nothing_is_told_anew_when_clearly_more_was_wanted_for_as_long_between() -> None:
    played = Played()
    played.wants(NARROW, 11.0)
    played.wants(NOT_NARROW, 9.5)
    played.wants(NARROW, 11.0)
    assert played.told == ["narrow"]
    played.wants(NOT_NARROW, 10.5)
    played.wants(NARROW, 11.0)
    assert played.told == ["narrow", "narrow"]


@pytest.mark.parametrize(("wanted", "what"), [(NARROW, "narrow"), (WIDEST, "bound")])
def test_what_is_doubted_when_somebody_else_comes_is_told_to_them_too(
    wanted: float, what: str
) -> None:
    played = Played()
    played.wants(wanted, 11.0)
    played.somebody_else_comes()
    assert played.told == [what]
    played.wants(wanted, 20.0)
    assert played.told == [what, what]
