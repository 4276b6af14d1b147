"""What electrodes were fired lately, and which ceilings *too strong* makes of it."""

from __future__ import annotations

import math

import pytest

from etd.stabilize.fired_ceiling import LATELY_NS, FiredCeilings, Lately
from etd.stabilize.said_electrode import MINUTE_NS, RISE_A_MINUTE

S = 1_000_000_000
COUNT = 4
ALL = range(COUNT)


class Played:
    """Pulses one after another, a tenth of a second apart."""

    def __init__(self) -> None:
        self.ceilings = FiredCeilings(COUNT)
        self.now_ns = 7 * MINUTE_NS

    def fire(
        self,
        electrode: int,
        fired_ua: int,
        wanted_ua: int | None = None,
        *,
        by_array: bool = False,
        by_own: bool = False,
    ) -> None:
        self.now_ns += S // 10
        wanted_ua = fired_ua if wanted_ua is None else wanted_ua
        self.ceilings.fired(
            electrode, fired_ua, wanted_ua, self.now_ns, by_array=by_array, by_own=by_own
        )

    def too_strong(self, *electrodes: int, left: float = 0.9) -> None:
        """None named: all."""
        those = dict.fromkeys(electrodes or ALL, left)
        self.ceilings.lower(those, self.now_ns, are_all=not electrodes)

    @property
    def most_ua(self) -> list[float]:
        return [self.ceilings.most_ua(electrode) for electrode in ALL]


def test_of_whole_pulses_there_is_no_ceiling() -> None:
    played = Played()
    played.fire(0, 3_000)
    played.too_strong()
    assert played.most_ua == [math.inf] * COUNT
    assert not played.ceilings


def test_a_stronger_pulse_that_was_whole_is_what_it_is_said_of() -> None:
    played = Played()
    played.fire(0, 3_000)
    played.fire(0, 1_000, 2_500)
    played.too_strong()
    assert not played.ceilings


def test_a_whole_pulse_between_does_not_hide_that_more_was_asked_for() -> None:
    """The soft start has come to 1000 uA meanwhile, and goes on."""
    played = Played()
    played.fire(0, 998, 3_000, by_array=True)
    played.fire(0, 1_000)
    played.too_strong()
    assert played.most_ua == pytest.approx([900.0] * COUNT)


@pytest.mark.parametrize("by_array", [True, False])
def test_a_soft_start_that_begins_anew_is_said_of_itself(by_array: bool) -> None:
    played = Played()
    played.fire(0, 3_000)
    played.fire(0, 500, 3_000, by_array=by_array, by_own=not by_array)
    played.too_strong()
    others = [450.0 if by_array else math.inf] * (COUNT - 1)
    assert played.most_ua == pytest.approx([450.0, *others])


def test_named_it_is_of_those_and_of_each_as_it_was_fired() -> None:
    played = Played()
    played.fire(0, 500, 3_000, by_array=True)
    played.fire(1, 1_000, 3_000, by_array=True)
    played.too_strong(0, 2)
    assert played.most_ua == pytest.approx([450.0, math.inf, math.inf, math.inf])
    played.too_strong()
    assert played.most_ua == pytest.approx([405.0, 900.0, 900.0, 900.0])


def test_a_cap_that_left_less_bounds_no_other_electrode() -> None:
    played = Played()
    played.fire(0, 1_000, 3_000)
    played.too_strong()
    assert played.most_ua == pytest.approx([900.0, math.inf, math.inf, math.inf])


def test_a_word_takes_of_a_ceiling_that_is_there_whatever_is_fired() -> None:
    played = Played()
    played.fire(0, 1_000, 3_000)
    played.too_strong()
    for _ in range(200):
        played.fire(0, 300)
    played.too_strong()
    assert played.most_ua[0] == pytest.approx(810.0)


def test_what_is_fired_later_takes_the_place_of_what_was() -> None:
    lately = Lately()
    lately.fired(1_000, 3_000, 0, by_ramp=False)
    lately.fired(400, 400, LATELY_NS, by_ramp=False)
    assert (lately.most_ua, lately.is_limited) == (1_000, True)
    lately.fired(400, 400, 2 * LATELY_NS, by_ramp=False)
    assert (lately.most_ua, lately.is_limited) == (400, False)


def test_after_a_pause_only_what_follows_counts() -> None:
    lately = Lately()
    lately.fired(1_000, 3_000, 0, by_ramp=False)
    lately.fired(400, 400, 2 * LATELY_NS, by_ramp=False)
    assert (lately.most_ua, lately.is_limited) == (400, False)


def test_it_rises_only_where_it_bound_a_pulse_of_the_last_minute() -> None:
    played = Played()
    for electrode in (0, 1):
        played.fire(electrode, 1_000, 3_000)
    played.too_strong()
    played.now_ns += MINUTE_NS - S
    played.fire(0, 900, 2_700)
    played.fire(1, 300)
    played.now_ns += 2 * S
    assert list(played.ceilings.binding_ua(ALL, played.now_ns)) == [0]
    assert not played.ceilings.let_rise((1, 2), played.now_ns, is_weak=True)
    assert played.ceilings.let_rise(ALL, played.now_ns, is_weak=True)
    assert played.most_ua[:2] == pytest.approx([900.0 * RISE_A_MINUTE, 900.0])
    assert played.ceilings.waits_ns(ALL, played.now_ns) is None, "it has risen"


def test_it_is_known_how_long_it_waits() -> None:
    played = Played()
    played.fire(0, 1_000, 3_000)
    played.too_strong()
    assert played.ceilings.waits_ns(ALL, played.now_ns) is None
    played.now_ns += 20 * S
    assert played.ceilings.let_rise(ALL, played.now_ns, is_weak=False)
    assert played.ceilings.waits_ns(ALL, played.now_ns) == 40 * S
    assert played.ceilings.waits_ns((1,), played.now_ns) is None


def test_hardly_anything_does_not_rise() -> None:
    played = Played()
    played.fire(0, 1_000, 3_000)
    played.too_strong(left=0.049)
    played.fire(0, 49, 147)
    played.now_ns += MINUTE_NS - S
    played.fire(0, 49, 147)
    played.now_ns += 2 * S
    assert played.ceilings.left(0) == pytest.approx(0.049)
    assert not played.ceilings.let_rise(ALL, played.now_ns, is_weak=True)
    assert not played.ceilings.binding_ua(ALL, played.now_ns)
    assert played.ceilings.left(1) == 1.0


def test_it_is_known_which_were_fired() -> None:
    played = Played()
    played.fire(0, 1_000, 3_000)
    played.fire(1, 1_000)
    assert [played.ceilings.was_fired(electrode) for electrode in ALL] == [True, True, False, False]
    assert [played.ceilings.is_limited(electrode) for electrode in ALL] == [True, *[False] * 3]


def test_nothing_was_fired_at_first() -> None:
    lately = Lately()
    assert (lately.most_ua, lately.is_limited, lately.fired_ns) == (0, False, None)


@pytest.mark.parametrize("second_ua", [990, 998])
def test_what_the_soft_start_lowers_more_of_stays_known(second_ua: int) -> None:
    """Frames in turn: the weaker one is whole by and by, the stronger one is not."""
    played = Played()
    played.fire(0, 990, 3_000, by_array=True)
    played.fire(0, second_ua, 1_000, by_array=True)
    played.fire(0, 1_000)
    played.too_strong()
    assert played.most_ua == pytest.approx([900.0] * COUNT)


def test_a_soft_start_of_all_that_begins_anew_does_so_at_each() -> None:
    played = Played()
    played.fire(0, 3_000)
    played.fire(0, 500, 3_000, by_array=True)
    played.fire(1, 600, 3_000, by_array=True)
    played.too_strong()
    assert played.most_ua == pytest.approx([450.0, 540.0, 540.0, 540.0])


def test_where_another_limit_leaves_still_less_it_is_said_of_that() -> None:
    played = Played()
    played.fire(0, 1_000, 3_000)
    played.too_strong()
    played.now_ns += 2 * LATELY_NS
    played.fire(0, 500, 2_700)
    played.too_strong()
    assert played.most_ua[0] == pytest.approx(450.0)


def test_a_ceiling_of_all_has_bound_nothing_where_weaker_pulses_were_whole() -> None:
    played = Played()
    played.fire(0, 1_000, 3_000, by_array=True)
    played.fire(1, 300)
    played.too_strong()
    assert list(played.ceilings.binding_ua(ALL, played.now_ns)) == [0]


def test_the_first_that_rises_is_waited_for() -> None:
    played = Played()
    for electrode in (0, 1):
        played.fire(electrode, 1_000, 3_000)
    played.too_strong(0)
    played.now_ns += 10 * S
    played.too_strong(1)
    played.now_ns += 10 * S
    assert played.ceilings.let_rise(ALL, played.now_ns, is_weak=True)
    assert played.ceilings.waits_ns(ALL, played.now_ns) == 40 * S
