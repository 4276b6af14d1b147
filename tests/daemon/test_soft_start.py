"""How fast current may rise."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.protocol.carried import RampState, SoftStartState
from etd.safety.soft_start import Ramp, SoftStart

MS, S = 1_000_000, 1_000_000_000
START_NS = 5_000 * MS
#: What the source makes of a current: a step of its own less, at the most.
CODE_UA = 10_000 / 4_095


def told(current_ua: int) -> int:
    return int(int(current_ua / CODE_UA) * CODE_UA)


@dataclass
class Wanting:
    """Pulses that take what a ramp lets through, and what was fired."""

    ramp: Ramp = field(default_factory=lambda: Ramp(8_000))
    fired: list[tuple[int, int]] = field(default_factory=list)

    def pulse(self, now_ns: int, wanted_ua: int = 10_000) -> int:
        """What was let through to it."""
        given_ua = min(wanted_ua, self.ramp.due(now_ns))
        commanded_ua = told(given_ua)
        if commanded_ua:
            self.ramp.fired(given_ua, commanded_ua, now_ns)
            self.fired.append((now_ns, commanded_ua))
        return given_ua

    def pulses(self, begin_ms: int, end_ms: int, apart_ms: int, wanted_ua: int = 10_000) -> int:
        """What was let through to the last one."""
        return [
            self.pulse(START_NS + at_ms * MS, wanted_ua)
            for at_ms in range(begin_ms, end_ms + 1, apart_ms)
        ][-1]


def test_the_ceiling_starts_at_zero_and_rises_half_a_milliampere_in_100_ms() -> None:
    wanting = Wanting()
    assert wanting.pulse(START_NS) == 0
    # A code of the source less at most for each 100 ms.
    assert wanting.pulses(10, 100, 10) == 500
    assert wanting.pulses(110, 200, 10) == pytest.approx(1_000, abs=3)
    assert wanting.pulses(210, 1_000, 10) == pytest.approx(5_000, abs=30)


def test_the_ceiling_rises_in_steps_of_50_ua_at_each_full_10_ms() -> None:
    ramp = Ramp(8_000)
    after_ns = [0, 10 * MS - 1, 10 * MS, 20 * MS - 1, 20 * MS]
    assert [ramp.due(START_NS + one_ns) for one_ns in after_ns] == [0, 0, 50, 50, 100]


def test_the_ceiling_ends_at_the_top() -> None:
    wanting = Wanting()
    assert wanting.pulses(0, 2_000, 10) == 8_000
    assert wanting.pulses(2_010, 3_000, 10) == 8_000


def test_time_alone_lets_nothing_rise() -> None:
    ramp = Ramp(8_000)
    assert [ramp.due(START_NS + at_ms * MS) for at_ms in range(0, 5_000, 10)][-1] == 500


def test_weak_pulses_let_the_ceiling_rise_half_a_milliampere_above_themselves() -> None:
    wanting = Wanting()
    wanting.pulses(0, 5_000, 10, wanted_ua=1_000)
    assert wanting.pulses(5_010, 5_010, 10) == told(1_000) + 500
    assert wanting.pulses(5_020, 5_100, 10) == told(1_000) + 500
    assert wanting.pulses(5_110, 5_110, 10) == pytest.approx(told(1_000) + 550, abs=3)


def test_steps_begin_at_a_pulse_below_the_ceiling_that_is_stronger_than_all_before() -> None:
    wanting = Wanting()
    wanting.pulse(START_NS)
    assert wanting.pulse(START_NS + 100 * MS, 300) == 300
    assert wanting.pulse(START_NS + 110 * MS) == 350


def test_weak_pulses_between_strong_ones_hold_nothing_up() -> None:
    wanting, since_ns = Wanting(), START_NS
    for scan in range(31):
        wanting.pulse(since_ns + scan * 20 * MS, 100)
        wanting.pulse(since_ns + scan * 20 * MS + 300_000)
    assert wanting.fired[-1][1] >= 2_400


def test_after_a_pause_it_goes_on_from_what_was_fired() -> None:
    wanting = Wanting()
    assert wanting.pulses(0, 100, 10) == 500
    assert wanting.pulse(START_NS + 5_000 * MS) == told(500) + 500


@pytest.mark.parametrize("pause_ns", [100 * MS, 5_003 * MS])
def test_after_a_pause_steps_begin_with_the_first_pulse_however_long_it_was(pause_ns: int) -> None:
    wanting, since_ns = Wanting(), START_NS + pause_ns
    wanting.pulse(START_NS)
    after_ns = [0, 100 * MS - 1, 100 * MS]
    assert [wanting.pulse(since_ns + one_ns) for one_ns in after_ns] == [500, 500, 550]


def test_after_a_minute_without_a_pulse_it_begins_at_zero() -> None:
    wanting = Wanting()
    wanting.pulses(0, 1_000, 10, wanted_ua=2_000)
    last_ns, later = wanting.fired[-1][0], wanting.ramp.copy()
    assert wanting.ramp.due(last_ns + 60 * S - 1) == told(2_000) + 500
    assert later.due(last_ns + 60 * S) == 0


def test_a_current_as_high_as_one_before_is_no_rise() -> None:
    wanting = Wanting()
    wanting.pulse(START_NS)
    for after_ms in (100, 110, 120):
        wanting.pulse(START_NS + after_ms * MS, 300)
    assert wanting.ramp.saved().rises == ((START_NS + 100 * MS, told(300)),)


def test_a_pulse_that_was_due_before_a_restart_raises_nothing_after_it() -> None:
    wanting = Wanting()
    wanting.pulses(0, 1_000, 10)
    wanting.ramp.restart()
    wanting.ramp.fired(5_000, told(5_000), START_NS + 1_001 * MS)
    assert wanting.pulse(START_NS + 1_010 * MS) == 0
    assert wanting.pulse(START_NS + 1_210 * MS) == 500


@pytest.mark.parametrize(("rate_hz", "within_s"), [(120, 0.68), (60, 0.75), (30, 0.85), (10, 1.3)])
def test_a_strong_frame_opens_in_about_the_same_time_at_usual_rates(
    rate_hz: int, within_s: float
) -> None:
    """To 3 mA; 0.6 s are 0.5 mA in 100 ms."""
    wanting, period_ns, now_ns = Wanting(), int(1e9 / rate_hz), START_NS
    while wanting.pulse(now_ns) < 3_000:
        now_ns += period_ns
    assert 0.6 <= (now_ns - START_NS) / 1e9 <= within_s


def test_a_restart_falls_to_zero_at_once() -> None:
    wanting = Wanting()
    wanting.pulses(0, 500, 10)
    wanting.ramp.restart()
    assert wanting.ramp.ceiling_ua == 0
    assert wanting.pulse(START_NS + 600 * MS) == 0
    assert wanting.pulse(START_NS + 700 * MS) == 500


pulses = st.tuples(
    st.one_of(st.integers(0, 3 * MS), st.integers(0, 300 * MS), st.just(100 * MS)),
    st.one_of(st.integers(0, 10_000), st.just(10_000), st.integers(0, 50)),
)


@given(st.lists(pulses, max_size=80))
def test_within_any_100_ms_no_pulse_exceeds_what_was_fired_before_by_more_than_half_a_milliampere(
    asked: list[tuple[int, int]],
) -> None:
    wanting, now_ns = Wanting(), START_NS
    for gap_ns, wanted_ua in asked:
        now_ns += gap_ns
        wanting.pulse(now_ns, wanted_ua)
    for at_ns, commanded_ua in wanting.fired:
        before_ua = max(
            (ua for fired_ns, ua in wanting.fired if fired_ns <= at_ns - 100 * MS), default=0
        )
        assert commanded_ua <= before_ua + 500


@given(st.lists(pulses, max_size=60), st.integers(0, 10_000))
def test_what_falls_falls_at_once_and_what_was_fired_is_free(
    asked: list[tuple[int, int]], wanted_ua: int
) -> None:
    wanting, now_ns = Wanting(), START_NS
    for gap_ns, one_ua in asked:
        now_ns += gap_ns
        wanting.pulse(now_ns, one_ua)
    highest_ua = max((ua for _, ua in wanting.fired), default=0)
    assert wanting.pulse(now_ns, wanted_ua) >= min(wanted_ua, highest_ua)


@given(st.lists(pulses, max_size=20))
def test_pulses_can_be_tried_on_a_copy(asked: list[tuple[int, int]]) -> None:
    wanting, now_ns = Wanting(), START_NS
    for gap_ns, one_ua in [*asked, (150 * MS, 300)]:
        now_ns += gap_ns
        wanting.pulse(now_ns, one_ua)
    before, tried = wanting.ramp.saved(), Wanting(wanting.ramp.copy())
    assert tried.ramp.saved() == before
    assert tried.pulse(now_ns + 200 * MS) == wanting.ramp.copy().due(now_ns + 200 * MS)
    assert wanting.ramp.saved() == before


# --- what is foretold ----------------------------------------------------------------------------

#: A foretold pulse ends 0.3 ms after it is due, and counts for 0.1 s from its end on.
APART_NS = 100_300_000


@pytest.mark.parametrize(
    ("current_ua", "period_ns", "periods"),
    [
        (0, APART_NS, 0),
        (1, APART_NS, 1),
        (500, APART_NS, 1),
        # The source makes 3 uA less of what it is given.
        (501, APART_NS, 2),
        (997, APART_NS, 2),
        (998, APART_NS, 3),
        (997, APART_NS - 1, 3),
        # At zero nothing is fired.
        (501, 200 * MS, 2),
        (500, 60 * S, 1),
        (500, 60 * S + 1, None),
        (8_000, APART_NS, 17),
        (8_001, APART_NS, None),
    ],
)
def test_a_rise_from_zero_is_foretold_in_whole_periods_within_a_minute(
    current_ua: int, period_ns: int, periods: int | None
) -> None:
    after_ns = Ramp(8_000).risen_after_ns(current_ua, period_ns, START_NS)
    assert after_ns == (None if periods is None else periods * period_ns)


@given(st.integers(501, 8_000), st.integers(1, 200))
def test_a_rise_has_come_when_it_was_foretold(current_ua: int, period_ms: int) -> None:
    """Foretelling goes from where the ramp is, and changes nothing of it."""
    ramp, period_ns = Ramp(8_000), period_ms * MS
    Wanting(ramp).pulses(0, 500, 10)
    now_ns = START_NS + 510 * MS
    before, after_ns = ramp.saved(), ramp.risen_after_ns(current_ua, period_ns, now_ns)
    assert ramp.saved() == before
    assert after_ns is not None
    wanting = Wanting(ramp)
    given_ua = [
        wanting.pulse(now_ns + place * period_ns) for place in range(after_ns // period_ns + 1)
    ]
    assert given_ua[-1] >= current_ua


def test_an_electrode_that_is_touched_again_opens_when_both_ramps_have_risen() -> None:
    opening = opening_at(1_000)
    opening.touched_again(4)
    now_ns = START_NS + 200 * MS
    after_ns = [opening.risen_after_ns(one, 1_400, 100 * MS, now_ns) for one in (4, 5)]
    assert after_ns == [500 * MS, 0]
    # Three pulses within a minute raise the one to 1 mA.
    after_ns = [opening.risen_after_ns(one, 1_400, 30 * S, now_ns) for one in (4, 5)]
    assert after_ns == [None, 0]
    assert opening.risen_after_ns(4, 8_001, 100 * MS, now_ns) is None
    assert opening.risen_after_ns(5, 8_001, 100 * MS, now_ns) is None


def test_many_small_looks_lose_nothing() -> None:
    ramp = Ramp(8_000)
    for tick in range(100_001):
        ramp.due(START_NS + tick * 1_000)
    assert ramp.ceiling_ua == 500


def opening_at(current_ua: int) -> SoftStart:
    opening = SoftStart(8_000)
    opening.due(START_NS)
    opening.fired(0, current_ua, current_ua, START_NS)
    return opening


def test_a_touch_after_none_ramps_that_electrode_alone() -> None:
    opening = opening_at(5_000)
    opening.touched_again(4)
    now_ns = START_NS + 1_000 * MS
    assert opening.recontact_ua(4, now_ns) == 0
    assert opening.recontact_ua(4, now_ns + 100 * MS) == 500
    assert opening.recontact_ua(5, now_ns + 100 * MS) is None
    assert opening.due(now_ns + 100 * MS) == 5_500


def test_what_others_were_fired_does_not_raise_an_electrodes_own_ramp() -> None:
    opening = opening_at(5_000)
    opening.touched_again(4)
    for at_ms in range(0, 1_000, 10):
        opening.fired(5, 5_000, 5_000, START_NS + at_ms * MS)
        assert opening.recontact_ua(4, START_NS + at_ms * MS) in range(501)


def test_an_electrodes_own_ramp_rises_through_its_own_pulses_and_stays() -> None:
    opening = opening_at(5_000)
    opening.touched_again(4)
    given_ua = 0
    for at_ms in range(0, 301, 10):
        now_ns = START_NS + at_ms * MS
        given_ua = min(1_000, opening.recontact_ua(4, now_ns) or 0)
        opening.fired(4, given_ua, given_ua, now_ns)
    assert given_ua == 1_000
    assert opening.recontact_ua(4, START_NS + 60_000 * MS) == 1_500


def test_a_second_touch_begins_at_zero_again() -> None:
    opening = opening_at(5_000)
    for _ in range(2):
        opening.touched_again(4)
        assert opening.recontact_ua(4, START_NS) == 0
        opening.fired(4, 300, 300, START_NS)


def test_a_restart_forgets_the_single_ramps() -> None:
    opening = opening_at(5_000)
    opening.touched_again(4)
    opening.restart()
    assert opening.recontact_ua(4, START_NS) is None
    assert opening.ceiling_ua == 0
    assert opening.due(START_NS + 1_000 * MS) == 0


def test_ceilings_are_looked_at_without_a_change() -> None:
    opening = opening_at(1_000)
    opening.touched_again(4)
    before, now_ns = opening.saved(), START_NS + 100 * MS
    assert opening.ceilings(now_ns) == (1_500, {4: 0})
    assert opening.saved() == before


def test_an_electrode_that_was_open_when_the_supply_went_off_ramps_alone_once_it_is_found() -> None:
    opening = opening_at(1_000)
    opening.supply_off([False, True, None, False])
    for electrode in range(4):
        opening.found(electrode, is_touched=electrode != 3)
    now_ns = START_NS + 100 * MS
    assert opening.ceilings(now_ns) == (1_500, {0: 0})
    # Open still, and found by the next power-up; what was found is not found again.
    opening.fired(0, 300, 300, now_ns)
    assert opening.recontact_ua(0, now_ns) == 0
    opening.fired(0, 300, 300, now_ns)
    for electrode in range(4):
        opening.found(electrode, is_touched=True)
    assert opening.ceilings(now_ns) == (1_500, {0: 300, 3: 0})


def test_where_the_person_said_too_strong_it_begins_at_zero_after_the_supply_was_off() -> None:
    opening = opening_at(1_000)
    opening.supply_off([False], is_lowered=True)
    assert opening.ceilings(START_NS + 100 * MS) == (0, {})
    opening.found(0, is_touched=True)
    assert opening.recontact_ua(0, START_NS + 100 * MS) == 0


def test_a_restart_forgets_what_was_open() -> None:
    opening = opening_at(1_000)
    opening.supply_off([False])
    opening.restart()
    opening.found(0, is_touched=True)
    assert opening.recontact_ua(0, START_NS) is None


# --- records --------------------------------------------------------------------------------------

RISING = RampState(
    reached_ua=700,
    fired_ua=690,
    settled_ua=300,
    rises=((START_NS - 20 * MS, 600), (START_NS - 10 * MS, 690)),
    counted_ns=START_NS - 13 * MS,
    due_ns=START_NS - 11 * MS,
    last_ns=START_NS - 10 * MS,
    ceiling_ua=700,
)


def test_a_ramp_that_no_pulse_was_due_at_is_saved_as_nothing() -> None:
    assert Ramp(8_000).saved() == RampState()


def test_a_ramp_is_resumed_in_the_time_of_the_clock_here() -> None:
    ramp = Ramp(8_000)
    ramp.resume(RISING, 7)
    behind = ramp.saved()
    assert behind.rises == ((START_NS - 20 * MS - 7, 600), (START_NS - 10 * MS - 7, 690))
    assert behind.counted_ns == START_NS - 13 * MS - 7
    assert behind.due_ns == START_NS - 11 * MS - 7
    assert behind.last_ns == START_NS - 10 * MS - 7
    ramp.resume(behind, -7)
    assert ramp.saved() == RISING


def test_a_soft_start_that_is_resumed_is_as_it_was_saved_and_keeps_nothing_of_its_own() -> None:
    state = SoftStartState(array=RISING, recontacts={2: RISING}, were_open=(1, 3))
    opening = opening_at(1_000)
    opening.touched_again(4)
    opening.supply_off([False])
    opening.resume(state, 0)
    assert opening.saved() == state


@given(
    st.lists(st.tuples(st.integers(1, 200), st.integers(0, 4_000)), max_size=40),
    st.integers(-(10**12), 10**12),
)
def test_a_ramp_that_is_resumed_from_a_record_rises_as_the_one_that_went_on(
    pulses: list[tuple[int, int]], ahead_ns: int
) -> None:
    """Half of the pulses come before the record, on a clock that is ahead."""
    went_on, resumed, t_ns = SoftStart(4_000), SoftStart(4_000), 0
    went_on.touched_again(1)
    for number, (apart_ms, wanted_ua) in enumerate(pulses):
        t_ns += apart_ms * 1_000_000
        if number == len(pulses) // 2:
            resumed.resume(went_on.saved(), ahead_ns)
        both = [(went_on, t_ns)]
        if number >= len(pulses) // 2:
            both.append((resumed, t_ns - ahead_ns))
        found = []
        for soft_start, now_ns in both:
            given_ua = min(wanted_ua, soft_start.due(now_ns))
            found.append((given_ua, soft_start.recontact_ua(1, now_ns)))
            if given_ua:
                soft_start.fired(1, given_ua, given_ua, now_ns + 300_000)
        assert len(set(found)) == 1
