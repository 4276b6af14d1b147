"""From a frame to visits: every refusal, the order, the defaults, and whether it fits."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_parts import (
    array,
    board_with,
    calibration,
    currents,
    frame,
    planner,
    site_with,
)
from etd.files.array import Array, Electrode
from etd.planning.plan import Plan
from etd.protocol.calibration import ElectrodeLimits
from etd.protocol.errors import Refused
from etd.protocol.frame import Ring

N = 16
LEVELS = (0.5,) * N


def refusal_of(made: Any, **fields: Any) -> Refused:
    with pytest.raises(Refused) as refusal:
        made.plan(frame(**fields))
    return refusal.value


def plan_of(**fields: Any) -> Plan:
    return planner().plan(frame(**fields))


def plan_or_code(**fields: Any) -> Plan | str:
    try:
        return plan_of(**fields)
    except Refused as refusal:
        return refusal.code


# --- levels ---------------------------------------------------------------------------------------


def test_a_level_without_a_calibration_is_refused() -> None:
    refusal = refusal_of(planner(), level=LEVELS)
    assert refusal.code == "level_needs_calibration"
    assert "current_ua" in refusal.reason


def test_levels_run_from_threshold_to_comfortable_and_zero_is_silent() -> None:
    made = planner(calibrated=calibration())
    levels = (0.0, 1e-9, 0.5, 1.0, *(0.0,) * 12)
    plan = made.plan(frame(level=levels))
    assert [(scheduled.electrode, scheduled.current_ua) for scheduled in plan.schedule] == [
        (1, 1_000),
        (2, 1_500),
        (3, 2_000),
    ]


def test_a_level_on_an_electrode_that_was_not_felt_is_refused_and_silence_there_is_not() -> None:
    """Its three figures are the cap: any level would be all that was ever tried."""
    felt = calibration().electrode[0]
    unfelt = ElectrodeLimits(threshold_ua=2_500, comfortable_ua=2_500, cap_ua=2_500, felt=False)
    made = planner(calibrated=calibration(electrode=(felt,) * 5 + (unfelt,) + (felt,) * 10))
    refusal = refusal_of(
        made, level=tuple(0.01 if electrode == 5 else 0.0 for electrode in range(N))
    )
    assert (refusal.code, refusal.electrode) == ("level_needs_calibration", 5)
    assert "calibrate it again" in refusal.reason
    plan = made.plan(frame(level=tuple(0.0 if electrode == 5 else 0.5 for electrode in range(N))))
    assert 5 not in {scheduled.electrode for scheduled in plan.schedule}
    named = made.plan(frame(current_ua=currents(e5=200)))
    assert [scheduled.current_ua for scheduled in named.schedule] == [200], (
        "a study says what it wants in uA"
    )


@pytest.mark.parametrize(
    ("key", "other"),
    [
        ("polarity", "cathodic"),
        ("polarity", ("anodic",) * 15 + ("biphasic",)),
        ("width_us", 99),
        ("width_us", (100,) * 15 + (101,)),
        ("rate_hz", 61.0),
        ("rate_hz", (30.0,) * 15 + (60.1,)),
        ("returns", Ring(ring_mm=2.0)),
        ("returns", tuple(((electrode + 1) % N,) for electrode in range(N))),
    ],
)
def test_a_level_frame_that_departs_from_its_calibration_is_refused(key: str, other: Any) -> None:
    refusal = refusal_of(planner(calibrated=calibration()), level=LEVELS, **{key: other})
    assert refusal.code == "bad_frame"
    assert key in refusal.reason


@pytest.mark.parametrize(
    ("key", "same"),
    [
        ("polarity", ("anodic",) * N),
        ("width_us", 100),
        ("width_us", (100,) * N),
        ("rate_hz", 60.0),
        ("rate_hz", (60.0,) * N),
        ("returns", "all"),
    ],
)
def test_a_level_frame_may_repeat_what_it_was_calibrated_with(key: str, same: Any) -> None:
    planner(calibrated=calibration()).plan(frame(level=LEVELS, **{key: same}))


RATES = st.floats(0.1, 60.0)


@given(rate_hz=RATES | st.tuples(*[RATES] * N))
def test_levels_at_a_lower_rate_are_the_same_pulses_less_often(
    rate_hz: float | tuple[float, ...],
) -> None:
    made = planner(calibrated=calibration())
    as_made, slower = (
        made.plan(frame(level=LEVELS)),
        made.plan(frame(level=LEVELS, rate_hz=rate_hz)),
    )
    rates_hz = rate_hz if isinstance(rate_hz, tuple) else (rate_hz,) * N
    for before, now in zip(as_made.schedule, slower.schedule, strict=True):
        assert (now.request, now.phases) == (before.request, before.phases)
        assert now.rate_hz == rates_hz[now.electrode]
    assert as_made.calibrated_hz is None
    assert slower.calibrated_hz == (60.0 if min(rates_hz) < 60.0 else None)


def test_a_higher_rate_than_calibrated_is_refused_with_what_can_be_done() -> None:
    made = planner(calibrated=calibration())
    refusal = refusal_of(made, level=LEVELS, rate_hz=100.0)
    assert "at most 60; or calibrate with rate_hz 100" in refusal.reason
    assert "current_ua" in refusal.reason
    assert made.plan(frame(level=LEVELS, rate_hz=60.0))
    assert planner(calibrated=calibration(rate_hz=100.0)).plan(frame(level=LEVELS, rate_hz=100.0))
    assert made.plan(frame(current_ua=currents(e1=500), rate_hz=100.0)).calibrated_hz is None


def test_a_rate_that_no_frame_may_have_is_not_sent_to_be_calibrated() -> None:
    reason = refusal_of(planner(calibrated=calibration()), level=LEVELS, rate_hz=150.0).reason
    assert "no frame here may have more than 120" in reason
    assert "calibrate with" not in reason


def test_a_current_frame_need_not_follow_the_calibration() -> None:
    plan = planner(calibrated=calibration()).plan(
        frame(current_ua=currents(e0=500), width_us=50, polarity="cathodic", rate_hz=20.0)
    )
    assert (plan.schedule[0].width_us, plan.schedule[0].phases) == (50, (False,))


# --- defaults -------------------------------------------------------------------------------------


def test_what_a_frame_does_not_say_comes_from_the_body_site() -> None:
    scheduled = plan_of(current_ua=currents(e0=500)).schedule[0]
    assert (scheduled.width_us, scheduled.rate_hz, scheduled.phases) == (100, 60.0, (True,))
    assert scheduled.returns is None


def test_what_a_frame_does_not_say_comes_from_the_calibration_if_there_is_one() -> None:
    made_with = calibration(
        width_us=70, rate_hz=33.0, polarity="biphasic", returns=Ring(ring_mm=2.0)
    )
    scheduled = planner(calibrated=made_with).plan(frame(current_ua=currents(e5=500))).schedule[0]
    assert (scheduled.width_us, scheduled.rate_hz, scheduled.phases) == (70, 33.0, (True, False))
    assert scheduled.returns == array().ring(5, 2.0)


@pytest.mark.parametrize(
    ("polarity", "phases"),
    [
        ("anodic", (True,)),
        ("cathodic", (False,)),
        ("biphasic", (True, False)),
        ("biphasic_cathodic_first", (False, True)),
    ],
)
def test_each_polarity_has_its_phases(polarity: str, phases: tuple[bool, ...]) -> None:
    assert plan_of(current_ua=currents(e0=500), polarity=polarity).schedule[0].phases == phases


def test_values_may_be_given_for_each_electrode() -> None:
    plan = plan_of(
        current_ua=(500,) * N,
        width_us=tuple(range(50, 50 + N)),
        rate_hz=tuple(float(5 + electrode) for electrode in range(N)),
    )
    assert [scheduled.width_us for scheduled in plan.schedule] == list(range(50, 66))
    assert [scheduled.rate_hz for scheduled in plan.schedule] == [
        float(5 + electrode) for electrode in range(N)
    ]


# --- maxima ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"current_ua": currents(e3=8_001), "width_us": 50}, "current 8001 uA.*8000 uA"),
        ({"current_ua": currents(e3=2_501), "width_us": 200, "rate_hz": 10.0}, "charge.*500 nC"),
        ({"current_ua": currents(e3=500), "rate_hz": 121.0}, "rate 121 Hz.*120 Hz"),
        ({"current_ua": currents(e3=2_501), "rate_hz": 120.0}, "mean current.*30 uA"),
        (
            {"current_ua": currents(e3=1_251), "rate_hz": 120.0, "polarity": "biphasic"},
            "mean current.*30 uA",
        ),
    ],
)
def test_what_asks_for_more_than_a_maximum_is_refused_by_number(
    fields: dict[str, Any], said: str
) -> None:
    refusal = refusal_of(planner(), **fields)
    assert refusal.code == "over_maximum"
    assert refusal.electrode == 3
    with pytest.raises(Refused, match=said):
        raise refusal


@pytest.mark.parametrize(
    "fields",
    [
        {"current_ua": currents(e3=8_000), "width_us": 50},
        {"current_ua": currents(e3=2_500), "width_us": 200, "rate_hz": 10.0},
        {"current_ua": currents(e3=500), "rate_hz": 120.0},
        {"current_ua": currents(e3=2_500), "rate_hz": 120.0},
        {"current_ua": currents(e3=1_250), "rate_hz": 120.0, "polarity": "biphasic"},
    ],
)
def test_exactly_a_maximum_is_accepted(fields: dict[str, Any]) -> None:
    plan_of(**fields)


def test_a_width_above_the_site_s_is_refused() -> None:
    made = planner(site=site_with(width_us=120))
    refusal = refusal_of(made, current_ua=currents(e3=500), width_us=121)
    assert (refusal.code, refusal.electrode) == ("over_maximum", 3)
    assert "width 121 us" in refusal.reason


def test_only_electrodes_that_are_felt_are_held_to_the_maxima() -> None:
    widths = (200,) + (100,) * 15
    made = planner(site=site_with(width_us=120))
    assert made.plan(frame(current_ua=currents(e3=500), width_us=widths)).schedule


def test_the_array_s_mean_current_is_refused_as_a_whole() -> None:
    made = planner(site=site_with(array_mean_current_ua=95))
    assert made.plan(frame(current_ua=(1_000,) * 15 + (800,), rate_hz=60.0))
    refusal = refusal_of(made, current_ua=(1_000,) * 15 + (1_000,), rate_hz=60.0)
    assert (refusal.code, refusal.electrode) == ("over_maximum", None)
    assert "96 uA" in refusal.reason


def test_the_board_s_maxima_count_as_well() -> None:
    refusal = refusal_of(planner(board=board_with(current_ua=900)), current_ua=currents(e3=901))
    assert refusal.code == "over_maximum"


# --- order and selections -------------------------------------------------------------------------


def shuffled() -> Array:
    """The electrodes hang on the outputs in reverse."""
    straight = array()
    electrodes = tuple(
        Electrode(x_mm=electrode.x_mm, y_mm=electrode.y_mm, output=15 - index)
        for index, electrode in enumerate(straight.electrode)
    )
    return Array(
        name=straight.name,
        title=straight.title,
        view=straight.view,
        mark=straight.mark,
        diameter_mm=straight.diameter_mm,
        electrode=electrodes,
    )


def test_visits_are_in_the_order_of_the_chain_not_of_the_electrodes() -> None:
    plan = planner(layout=shuffled()).plan(frame(current_ua=currents(e1=500, e4=500, e9=500)))
    assert [scheduled.electrode for scheduled in plan.schedule] == [9, 4, 1]
    assert [scheduled.selection.output for scheduled in plan.schedule] == [6, 11, 14]


def test_explicit_returns_are_turned_into_outputs() -> None:
    sets = tuple(((electrode + 1) % N,) for electrode in range(N))
    plan = planner(layout=shuffled()).plan(frame(current_ua=currents(e4=500), returns=sets))
    assert plan.schedule[0].returns == (5,)
    assert plan.schedule[0].selection.returns == 1 << 10


def test_a_ring_takes_the_electrodes_at_that_radius() -> None:
    plan = plan_of(current_ua=currents(e5=500), returns=Ring(ring_mm=2.0))
    assert plan.schedule[0].returns == array().ring(5, 2.0)


@pytest.mark.parametrize("returns", [Ring(ring_mm=90.0), ((1,), (), *((0,),) * 14)])
def test_an_electrode_without_a_return_is_refused(returns: Any) -> None:
    refusal = refusal_of(planner(), current_ua=currents(e1=500), returns=returns)
    assert (refusal.code, refusal.electrode) == ("board_cannot", 1)
    assert "no return" in refusal.reason


def test_a_silent_electrode_needs_no_return() -> None:
    assert plan_of(current_ua=currents(e0=500), returns=((1,), *((),) * 15)).schedule


def test_what_the_board_cannot_select_is_refused() -> None:
    refusal = refusal_of(
        planner(can_choose=False), current_ua=currents(e1=500), returns=Ring(ring_mm=2.0)
    )
    assert (refusal.code, refusal.electrode) == ("board_cannot", 1)


# --- clamps told before ---------------------------------------------------------------------------


def caps(**only: int) -> list[int]:
    """3000 uA everywhere but at the named ones."""
    changed = {int(name[1:]): value for name, value in only.items()}
    return [changed.get(electrode, 3_000) for electrode in range(N)]


def test_the_reply_tells_what_the_own_cap_takes_away() -> None:
    plan = planner(caps_ua=caps(e2=700)).plan(frame(current_ua=currents(e2=900)))
    (clamp,) = plan.clamped
    assert (clamp.electrode, clamp.wanted_ua, clamp.allowed_ua) == (2, 900, 700)
    assert (clamp.reason, clamp.limited_by) == ("cap", 2)
    assert plan.schedule[0].current_ua == 900, "the wish stays: limits have the last word later"


@pytest.mark.parametrize(
    "returns", [Ring(ring_mm=2.0), tuple(((electrode + 1) % N,) for electrode in range(N))]
)
def test_in_a_ring_or_a_set_each_return_counts_as_if_it_alone_carried_the_current(
    returns: Any,
) -> None:
    plan = planner(caps_ua=caps(e3=700)).plan(frame(current_ua=currents(e2=900), returns=returns))
    (clamp,) = plan.clamped
    assert (clamp.electrode, clamp.allowed_ua) == (2, 700)
    assert (clamp.reason, clamp.limited_by) == ("return_cap", 3)


def test_the_scan_has_the_rate_of_its_fastest_electrode() -> None:
    plan = plan_of(
        current_ua=(500,) * N, rate_hz=tuple(float(10 + electrode) for electrode in range(N))
    )
    assert plan.rate_hz == 25.0
    assert plan.period_ns == 40_000_000


def test_what_does_not_fit_is_refused_and_the_rate_that_does_is_told() -> None:
    made = planner(layout=array("grid-8x8"))
    refusal = refusal_of(made, current_ua=(300,) * 64, rate_hz=120.0)
    assert refusal.code == "too_fast"
    assert refusal.achievable_hz is not None
    assert 20 < refusal.achievable_hz < 120
    assert f"{refusal.achievable_hz:.1f} Hz" in refusal.reason
    plan = made.plan(frame(current_ua=(300,) * 64, rate_hz=refusal.achievable_hz))
    assert plan.rate_hz == refusal.achievable_hz


def test_thin_slows_down_says_so_and_what_it_gives_can_be_asked_for() -> None:
    made = planner(layout=array("grid-8x8"))
    plan = made.plan(frame(current_ua=(300,) * 64, rate_hz=120.0, allow_slower=True))
    (shortfalls,) = plan.slowed
    assert shortfalls.reason == "rate"
    assert shortfalls.rate_hz == plan.rate_hz
    assert plan.period_ns == int(1e9 / plan.rate_hz)
    again = made.plan(frame(current_ua=(300,) * 64, rate_hz=plan.rate_hz))
    assert not again.slowed


def test_thin_changes_nothing_where_the_rate_fits() -> None:
    plan = plan_of(current_ua=(300,) * N, rate_hz=60.0, allow_slower=True)
    assert (plan.rate_hz, plan.slowed) == (60.0, ())


def test_a_frame_is_not_slower_the_less_it_asks_for() -> None:
    made = planner(layout=array("grid-8x8"))
    achievable = []
    for many in (16, 32, 64):
        wanted = (100,) * many + (0,) * (64 - many)
        refusal = refusal_of(
            made, current_ua=wanted, width_us=200, rate_hz=120.0, polarity="biphasic"
        )
        achievable.append(refusal.achievable_hz or 0.0)
    assert achievable == sorted(achievable, reverse=True)


def test_a_silent_frame_is_a_plan_without_visits() -> None:
    plan = plan_of(current_ua=(0,) * N)
    assert (plan.schedule, plan.clamped, plan.slowed) == ((), (), ())
    assert plan.period_ns > 0


@given(
    st.lists(st.just(0) | st.integers(3, 10_000), min_size=N, max_size=N),
    st.integers(20, 200),
    st.floats(0.1, 200.0),
    st.sampled_from(["anodic", "cathodic", "biphasic", "biphasic_cathodic_first"]),
)
def test_whatever_is_accepted_is_within_every_maximum(
    wanted_ua: list[int], width_us: int, rate_hz: float, polarity: str
) -> None:
    fields = {"width_us": width_us, "rate_hz": rate_hz, "polarity": polarity, "allow_slower": True}
    plan = plan_or_code(current_ua=tuple(wanted_ua), **fields)
    if not isinstance(plan, Plan):
        assert plan == "over_maximum"
        return
    assert plan.rate_hz <= max(rate_hz, 60.0)
    for scheduled in plan.schedule:
        assert scheduled.current_ua == wanted_ua[scheduled.electrode] <= 8_000
        assert scheduled.current_ua * scheduled.width_us <= 500_000
        charge_pc = scheduled.current_ua * scheduled.width_us * len(scheduled.phases)
        assert charge_pc * scheduled.rate_hz <= 30e6 * (1 + 1e-9)
    assert len(plan.schedule) == sum(1 for electrode in wanted_ua if electrode)


def test_a_calibration_s_weak_electrode_caps_its_neighbor_s_ring() -> None:
    limits = ElectrodeLimits(threshold_ua=1_000, comfortable_ua=2_000, cap_ua=3_000)
    weak = ElectrodeLimits(threshold_ua=100, comfortable_ua=200, cap_ua=300)
    made = planner(calibrated=calibration(electrode=(limits, weak, *(limits,) * 14)))
    plan = made.plan(frame(current_ua=currents(e0=900), returns=Ring(ring_mm=2.0)))
    (clamp,) = plan.clamped
    assert (clamp.allowed_ua, clamp.reason, clamp.limited_by) == (300, "return_cap", 1)


def test_less_than_one_step_of_the_source_is_refused_and_not_dropped() -> None:
    assert plan_or_code(current_ua=(2,) + (0,) * (N - 1)) == "bad_frame"
    assert isinstance(plan_or_code(current_ua=(3,) + (0,) * (N - 1)), Plan)
