"""Why a frame cannot be shown for ever, against a circuit that shares each pulse by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from engine_parts import array, board_file, body_site, frame, planner
from etd.planning.headroom import Headroom, PlanRules
from etd.planning.net_forecast import NetForecast, NetLimit
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity
from etd.safety.limits import PersonLimits
from etd.safety.maxima import maxima_of
from etd.safety.net_charge import NetState

N = 16
BOUND_UC = 10.0
RATES_HZ = (60.0, 45.0, 20.0)


def forecast(bound_uc: float = BOUND_UC) -> NetForecast:
    maxima = maxima_of(board_file(), body_site())
    person = PersonLimits((3_000,) * N, maxima.width_us, maxima.width_us, None)
    rules = PlanRules(array(), body_site(), maxima, person, 10_000 / 4_095)
    return NetForecast(N, int(bound_uc * 1e6), Headroom(rules))


def direct_ua(
    schedule: Sequence[ScheduledPulse],
    visits: float,
    conducts_s: Sequence[float],
    rate_hz: float | None = None,
) -> list[float]:
    """What each electrode gets in the mean, pulse by pulse and return by return; `rate_hz`: of all,
    instead of their own.
    """
    found = [0.0] * N
    for pulse in schedule:
        way = 0 if len(pulse.phases) == 2 else 1 if pulse.phases[0] else -1
        hz = pulse.rate_hz if rate_hz is None else rate_hz
        mean_ua = way * pulse.current_ua * pulse.width_us * 1e-6 * hz * visits
        others = [at for at in range(N) if at != pulse.electrode]
        returns = others if pulse.returns is None else list(pulse.returns)
        whole_s = sum(conducts_s[at] for at in returns)
        found[pulse.electrode] += mean_ua
        for at in returns:
            found[at] -= mean_ua * conducts_s[at] / whole_s
    return found


def until_s(current_ua: float, left_uc: float, scan_uc: float) -> float:
    """By Euler's way, in steps of a ten-thousandth; infinite: it never gets there."""
    way = math.copysign(1.0, current_ua)
    left, room = way * left_uc, BOUND_UC - scan_uc
    if abs(current_ua) <= room:
        return math.inf
    at_s = 0.0
    while left < room:
        left += (abs(current_ua) - left) * 1e-4
        at_s += 1e-4
    return at_s


currents = st.lists(st.sampled_from([0, 0, 0, 900, 1_600, 2_400]), min_size=N, max_size=N)
ways = st.lists(st.sampled_from(["anodic", "cathodic", "biphasic"]), min_size=N, max_size=N)
rates = st.lists(st.sampled_from(RATES_HZ), min_size=N, max_size=N)
conductances = st.lists(st.sampled_from([1.0, 1.0, 5.0, 30.0]), min_size=N, max_size=N)
left = st.lists(st.floats(-9.0, 9.0), min_size=N, max_size=N)
NAMED = tuple(((at + 1) % N, (at + 5) % N) for at in range(N))
TWO = [2_400 if at in (3, 9) else 0 for at in range(N)]
FAST_AND_SLOW = [20.0 if at == 3 else 60.0 for at in range(N)]
EVEN = [1.0] * N


@settings(max_examples=150)
@given(
    currents,
    ways,
    rates,
    conductances,
    left,
    st.booleans(),
    st.sampled_from([1.0, 0.7]),
    st.sampled_from([1, 2]),
)
@example(TWO, ["anodic"] * N, FAST_AND_SLOW, EVEN, [0.0] * N, False, 1.0, 1)
@example(TWO, ["anodic"] * N, FAST_AND_SLOW, [30.0, *EVEN[1:]], [-9.0] * N, True, 1.0, 2)
@example(TWO, ["anodic"] * N, [60.0] * N, EVEN, [0.0] * N, False, 0.8, 1)
def test_the_first_electrode_at_its_bound_when_and_the_rate_that_lasts(
    wanted_ua: list[int],
    polarity: list[Polarity],
    rate_hz: list[float],
    conducts_s: list[float],
    left_uc: list[float],
    is_named: bool,
    slowdown: float,
    pulses: int,
) -> None:
    asked = frame(
        current_ua=tuple(wanted_ua),
        polarity=tuple(polarity),
        rate_hz=tuple(rate_hz),
        width_us=100,
        returns=NAMED if is_named else None,
        allow_slower=True,
        pulses=1,
    )
    schedule = planner().plan(asked).schedule
    state = NetState(conducts_s, [one * 1e6 for one in left_uc])
    limit = forecast().limit(asked, schedule, slowdown, pulses, [state])
    visits = slowdown * pulses
    fastest_hz = max([pulse.rate_hz for pulse in schedule], default=1.0)
    once_uc = {
        pulse.electrode: pulse.current_ua * pulse.width_us * 1e-6
        for pulse in schedule
        if len(pulse.phases) == 1
    }
    expected: dict[int, float] = {}
    for at, mean_ua in enumerate(direct_ua(schedule, visits, conducts_s)):
        scan_uc = max(once_uc.get(at, 0.0), abs(mean_ua) / (fastest_hz * visits))
        after_s = until_s(mean_ua, left_uc[at], scan_uc)
        if after_s < math.inf:
            expected[at] = after_s
    if not expected:
        assert limit is None
        return
    assert limit is not None
    after_s = expected[limit.electrode]
    assert after_s == pytest.approx(min(expected.values()), abs=0.003)
    assert limit.after_s == pytest.approx(after_s, rel=0.01, abs=0.003)
    # With all of them at the rate that is named, a fifth is left at least, and none is raised.
    slowest_hz = min(pulse.rate_hz for pulse in schedule)
    assert limit.lasting_hz <= slowest_hz
    most_part = 0.0
    for at, mean_ua in enumerate(direct_ua(schedule, pulses, conducts_s, limit.lasting_hz)):
        scan_uc = max(once_uc.get(at, 0.0), abs(mean_ua) / max(0.1, limit.lasting_hz * pulses))
        most_part = max(most_part, abs(mean_ua) / (BOUND_UC - scan_uc))
    assert most_part <= 0.8 + 1e-9
    if limit.lasting_hz < slowest_hz - 0.1:
        assert most_part * (1 + 0.11 / max(0.11, limit.lasting_hz)) >= 0.8


@pytest.mark.parametrize(
    ("asked", "slowdown", "pulses", "shown_s"),
    [
        ({"ttl_ms": 50}, 1.0, 1, 0.05),
        ({"ttl_ms": 1_000}, 1.0, 1, 0.2),
        ({"ttl_ms": 200, "pulses": 6}, 1.0, 1, 0.1),
        ({"ttl_ms": 200, "pulses": 6}, 1.0, 2, 0.05),
        ({"ttl_ms": 200, "pulses": 3}, 0.5, 1, 0.1),
        ({"ttl_ms": 200, "pulses": 600}, 1.0, 1, 0.2),
        ({"ttl_ms": 200, "pulses": 3, "rate_hz": tuple(FAST_AND_SLOW)}, 1.0, 1, 0.15),
    ],
)
def test_how_long_a_frame_is_shown_as_it_says_itself(
    asked: dict[str, object], slowdown: float, pulses: int, shown_s: float
) -> None:
    """Two electrodes; of six pulses at 60 Hz the last comes after a tenth of a second, and where
    one has 20 Hz three take 150 ms.
    """
    made = frame(**{"current_ua": tuple(TWO), "width_us": 100, "rate_hz": 60.0, **asked})
    schedule = planner().plan(made).schedule
    limit = forecast(2.0).limit(made, schedule, slowdown, pulses, ())
    assert limit is not None
    assert limit.shown_s == pytest.approx(shown_s, rel=1e-9)


def test_a_return_that_may_conduct_more_beside_the_others_reaches_the_bound_first() -> None:
    """Of 18 uA at two others it gets three sevenths, or the whole."""
    made = frame(current_ua=tuple(TWO), width_us=100, rate_hz=60.0)
    schedule = planner().plan(made).schedule
    silent = next(at for at, wanted_ua in enumerate(TWO) if not wanted_ua)
    most_s = [(N - 1.0) if at == silent else 1.0 for at in range(N)]
    beside = forecast(2.0).limit(
        made, schedule, 1.0, 1, [NetState(most_s, [0.0] * N, beside_s=[1.0] * N)]
    )
    alone = forecast(2.0).limit(made, schedule, 1.0, 1, [NetState(most_s, [0.0] * N)])
    assert beside is not None
    assert alone is not None
    assert beside.electrode == silent
    assert beside.after_s < 0.8 * alone.after_s


def test_of_named_returns_each_has_its_part_or_in_the_account_of_the_most_all() -> None:
    """Of 2 x 6 uA through the same two: none reaches 10 uC by its half."""
    named = tuple((2, 3) if at < 2 else (0,) for at in range(N))
    wanted_ua = (1_000, 1_000, *[0] * (N - 2))
    made = frame(current_ua=wanted_ua, returns=named, width_us=100, rate_hz=60.0)
    schedule = planner().plan(made).schedule
    evenly, at_most = (
        NetState([1.0] * N, [0.0] * N, is_named_whole=is_whole) for is_whole in (False, True)
    )
    assert forecast().limit(made, schedule, 1.0, 1, [evenly]) is None
    assert NetState([1.0] * N, [0.0] * N) == evenly
    whole = forecast().limit(made, schedule, 1.0, 1, [at_most])
    assert whole is not None
    assert whole.electrode == 2


def test_nothing_is_left_where_no_account_says_what_is() -> None:
    made = frame(current_ua=tuple(TWO), width_us=100, rate_hz=60.0)
    schedule = planner().plan(made).schedule
    even = forecast().limit(made, schedule, 1.0, 1, [NetState([1.0] * N, [0.0] * N)])
    assert forecast().limit(made, schedule, 1.0, 1, ()) == even
    assert even is not None
    assert forecast().limit(frame(current_ua=(0,) * N), (), 1.0, 1, ()) is None


def test_the_account_by_which_the_bound_comes_first_counts() -> None:
    made = frame(current_ua=tuple(TWO), width_us=100, rate_hz=60.0)
    schedule = planner().plan(made).schedule
    empty, filled = (
        NetState([1.0] * N, [uc * 1e6 if at == 3 else 0.0 for at in range(N)]) for uc in (0.0, 5.0)
    )
    for both in ((empty, filled), (filled, empty)):
        assert forecast().limit(made, schedule, 1.0, 1, both) == forecast().limit(
            *(made, schedule, 1.0, 1, [filled])
        )


def test_what_would_be_reached_as_it_ends_is_shown_and_told() -> None:
    (told,) = forecast().told(NetLimit(3, after_s=0.2, lasting_hz=41.5, shown_s=0.2))
    assert (told.electrode, told.lasts_ms, told.lasting_hz) == (3, 200, 41.5)
    assert forecast().told(None) == ()


def test_a_refusal_names_the_time_the_bound_and_a_rate_only_where_one_lasts() -> None:
    with pytest.raises(Refused) as refused:
        forecast().told(NetLimit(3, after_s=0.1994, lasting_hz=41.5, shown_s=0.2))
    assert "electrode 3: after 199 ms of this frame more than 10 uC" in refused.value.reason
    assert " rate_hz=41.5 lasts, or show it for less long" in refused.value.reason
    assert refused.value.reason.endswith("or with lower currents")
    with pytest.raises(Refused) as refused:
        forecast().told(NetLimit(3, after_s=0.1, lasting_hz=41.5, shown_s=0.2), "too fast")
    assert refused.value.reason.endswith(
        "or with lower currents. It cannot be balanced here: too fast"
    )
    for lasting_hz, is_named in ((0.0, False), (0.1, True)):
        with pytest.raises(Refused) as refused:
            forecast().told(NetLimit(3, after_s=0.0, lasting_hz=lasting_hz, shown_s=0.2))
        assert ("rate_hz=" in refused.value.reason) == is_named


def test_a_pulse_that_is_more_than_the_bound_has_no_rate_that_lasts() -> None:
    made = frame(current_ua=tuple(TWO), width_us=100, rate_hz=60.0)
    schedule = planner().plan(made).schedule
    limit = forecast(0.2).limit(made, schedule, 1.0, 1, ())
    assert limit is not None
    assert (limit.after_s, limit.lasting_hz) == (0.0, 0.0)


@pytest.mark.parametrize(("cap_ua", "has_limit"), [(2_000, True), (100, False)])
def test_what_a_cap_leaves_counts_and_not_what_was_asked(cap_ua: int, has_limit: bool) -> None:
    capped = planner(caps_ua=[cap_ua] * N)
    asked, allowed = (
        frame(current_ua=tuple(min(ua, most_ua) for ua in TWO), width_us=100, rate_hz=60.0)
        for most_ua in (2_400, cap_ua)
    )
    limits = [
        forecast().limit(made, capped.plan(made).schedule, 1.0, 1, ()) for made in (asked, allowed)
    ]
    assert limits[0] == limits[1]
    assert (limits[0] is not None) == has_limit


def test_what_ends_at_its_bound_and_not_above_it_lasts() -> None:
    """6 uA through one return, and 0.1 uC of a pulse above that: 6.1 uC."""
    named = tuple((1,) if at == 0 else (0,) for at in range(N))
    made = frame(current_ua=(1_000, *[0] * (N - 1)), returns=named, width_us=100, rate_hz=60.0)
    schedule = planner().plan(made).schedule
    assert forecast(6.1).limit(made, schedule, 1.0, 1, ()) is None
    limit = forecast(6.09).limit(made, schedule, 1.0, 1, ())
    assert limit is not None
    assert limit.electrode in (0, 1)


def test_the_rate_that_lasts_is_of_the_electrode_that_needs_the_lowest() -> None:
    """The one that is first is weak and was used before; the other one is strong, and clean."""
    wanted_ua = [2_000 if at == 3 else 2_400 if at == 9 else 0 for at in range(N)]
    made = frame(current_ua=tuple(wanted_ua), width_us=100, rate_hz=60.0)
    schedule = planner().plan(made).schedule
    state = NetState([1.0] * N, [9e6 if at == 3 else 0.0 for at in range(N)])
    limit = forecast().limit(made, schedule, 1.0, 1, [state])
    alone = frame(current_ua=tuple(one if one > 2_200 else 0 for one in wanted_ua), width_us=100)
    of_the_strong = forecast().limit(alone, planner().plan(alone).schedule, 1.0, 1, ())
    assert limit is not None
    assert of_the_strong is not None
    assert limit.electrode == 3
    assert limit.lasting_hz == pytest.approx(of_the_strong.lasting_hz, rel=0.06)


def test_where_returns_are_not_known_a_rate_is_named_for_one_electrode_alone() -> None:
    both = frame(current_ua=tuple(TWO), width_us=100, rate_hz=60.0)
    one = frame(current_ua=(2_400, *[0] * (N - 1)), width_us=100, rate_hz=60.0)
    for made, is_named in ((both, False), (one, True)):
        schedule = planner().plan(made).schedule
        limit = forecast().limit(made, schedule, 1.0, 1, (), are_returns_known=False)
        assert limit is not None
        assert (limit.lasting_hz > 0.0) == is_named
        (told,) = forecast().told(NetLimit(limit.electrode, 1.0, limit.lasting_hz, limit.shown_s))
        assert (told.lasting_hz is not None) == is_named


def test_the_rate_that_lasts_does_by_each_account() -> None:
    """Evenly shared the pulses themselves are first; else a return that carries them all."""
    made = frame(current_ua=tuple(TWO), width_us=100, rate_hz=60.0)
    schedule = planner().plan(made).schedule
    carries_all = NetState([100.0 if at == 5 else 1.0 for at in range(N)], [0.0] * N)
    evenly = NetState([1.0] * N, [0.0] * N)
    lasting_hz = []
    for states in ([carries_all], [evenly], [evenly, carries_all], [carries_all, evenly]):
        limit = forecast().limit(made, schedule, 1.0, 1, states)
        assert limit is not None
        lasting_hz.append(limit.lasting_hz)
    least_hz, more_hz, *both_hz = lasting_hz
    assert least_hz < 0.7 * more_hz
    assert both_hz == [least_hz, least_hz]
