"""A frame of single phases on a body site that balances: what is planned, and what is told."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_parts import array, body_site, calibration, currents, frame, planner
from etd.planning.net_balance import is_to_balance
from etd.planning.net_forecast import NetLimit
from etd.planning.outlook import Outlook
from etd.planning.plan import Plan
from etd.protocol.errors import Refused
from etd.protocol.frame import PHASES, Frame, Polarity
from etd.safety.net_charge import NetState

N = 16
BALANCES = msgspec.structs.replace(body_site(), balance="biphasic")
#: 2.4 mA, 100 us, 60 times a second: the bound is reached after 1.1 s.
STRONG = {"current_ua": currents(e3=2_400), "width_us": 100, "rate_hz": 60.0}


def told(plan: Plan) -> list[tuple[int | None, str]]:
    return [(it.electrode, it.reason) for it in plan.slowed]


def phases(plan: Plan) -> list[tuple[bool, ...]]:
    return [scheduled.phases for scheduled in plan.schedule]


def left_uc(nc: float) -> Outlook:
    """So much is on electrode 3."""
    on = [nc * 1e3 if electrode == 3 else 0.0 for electrode in range(N)]
    return Outlook(lambda path: path, 3_000, {}, [True] * N, net=[NetState([1.0] * N, on)])


@pytest.mark.parametrize(
    ("polarity", "both"),
    [("anodic", (True, False)), ("cathodic", (False, True)), (None, (True, False))],
)
def test_what_could_not_stand_gets_both_phases_its_own_first_and_is_told(
    polarity: Polarity | None, both: tuple[bool, ...]
) -> None:
    plan = planner(site=BALANCES).plan(frame(**STRONG, polarity=polarity))
    assert phases(plan) == [both]
    assert told(plan) == [(3, "balanced")]


def test_no_shipped_site_balances_and_there_it_is_told_how_long_it_lasts() -> None:
    assert body_site().balance is None
    plan = planner().plan(frame(**STRONG))
    assert phases(plan) == [(True,)]
    assert told(plan) == [(3, "net_charge")]


def test_what_can_stand_is_left_as_it_is() -> None:
    plan = planner(site=BALANCES).plan(frame(**{**STRONG, "rate_hz": 40.0}))
    assert phases(plan) == [(True,)]
    assert told(plan) == []


@pytest.mark.parametrize("nc", [-9_000.0, 0.0, 9_900.0])
def test_what_was_left_before_decides_nothing(nc: float) -> None:
    """A frame that is renewed is felt the same all the time."""
    made = planner(site=BALANCES)
    assert phases(made.plan(frame(**STRONG), left_uc(nc))) == [(True, False)]
    weak = frame(current_ua=currents(e3=800), width_us=100, rate_hz=60.0)
    assert phases(made.plan(weak, left_uc(min(nc, 9_000.0)))) == [(True,)]


def test_of_a_mixed_frame_all_single_phases_get_the_other_one() -> None:
    plan = planner(site=BALANCES).plan(
        frame(
            current_ua=currents(e3=2_400, e4=500, e5=500),
            polarity=tuple("cathodic" if it == 4 else "anodic" for it in range(N)),
            width_us=100,
            rate_hz=50.0,
        )
    )
    by = {scheduled.electrode: scheduled.phases for scheduled in plan.schedule}
    assert by == {3: (True, False), 4: (False, True), 5: (True, False)}


def test_so_many_pulses_as_stay_within_the_bound_are_left_as_they_are() -> None:
    few = planner(site=BALANCES).plan(frame(**STRONG, pulses=5))
    assert phases(few) == [(True,)]
    # Three of them are 0.7 uC, and 9.9 are there already.
    more = planner(site=BALANCES).plan(frame(**STRONG, pulses=5), left_uc(9_900.0))
    assert phases(more) == [(True, False)]


def test_as_many_pulses_as_reach_the_bound_and_do_not_pass_it_are_left_as_they_are() -> None:
    five = frame(**STRONG, pulses=5)
    assert not is_to_balance(five, NetLimit(3, after_s=0.1, lasting_hz=40.0, shown_s=0.1))
    assert is_to_balance(five, NetLimit(3, after_s=0.099, lasting_hz=40.0, shown_s=0.1))


def test_who_asks_for_what_was_sent_or_nothing_gets_no_other_pulses() -> None:
    made = planner(site=BALANCES)
    plan = made.plan(frame(**STRONG, strict=True))
    assert phases(plan) == [(True,)]
    assert told(plan) == [(3, "net_charge")]
    with pytest.raises(Refused, match="net charge would be on it"):
        made.plan(frame(**STRONG, strict=True), left_uc(9_900.0))


def test_levels_need_a_calibration_for_both_phases() -> None:
    made = calibration(N, width_us=100, rate_hz=60.0, polarity="anodic")
    levels = tuple(1.0 if electrode == 3 else 0.0 for electrode in range(N))
    limits = made.electrode[3]
    strong = msgspec.structs.replace(limits, comfortable_ua=2_400)
    made = msgspec.structs.replace(
        made, electrode=tuple(strong if it == 3 else limits for it in range(N))
    )
    with pytest.raises(Refused) as refused:
        planner(site=BALANCES, calibrated=made).plan(frame(level=levels))
    assert refused.value.code == "bad_frame"
    assert "so it gets both phases" in refused.value.reason
    assert "calibrated to with polarity anodic" in refused.value.reason


def test_a_rate_without_room_for_both_phases_is_refused_with_the_rate_that_has() -> None:
    """60 of 64, whose current the other four carry back: of one phase it lasts for 6 s."""
    many = {"current_ua": (*(4 * (0,)), *(60 * (2_700,))), "rate_hz": 38.0, "width_us": 100}
    layout = array("grid-8x8")
    assert told(planner(layout=layout).plan(frame(**many))) == [(0, "net_charge")]
    with pytest.raises(Refused) as refused:
        planner(site=BALANCES, layout=layout).plan(frame(**many))
    assert refused.value.code == "too_fast"
    assert refused.value.achievable_hz == pytest.approx(35.6, abs=0.1)
    assert refused.value.bound_by == "wire"
    assert "so it gets both phases" in refused.value.reason


@settings(max_examples=60)
@given(
    st.lists(st.sampled_from([0, 0, 500, 1_500, 2_500]), min_size=N, max_size=N).filter(any),
    st.lists(st.sampled_from(list(PHASES)), min_size=N, max_size=N),
    st.floats(-9_000.0, 9_000.0),
)
def test_no_frame_on_such_a_site_leaves_more_than_the_bound_for_ever(
    wanted_ua: list[int], polarity: list[Polarity], nc: float
) -> None:
    asked: Frame = frame(
        current_ua=tuple(wanted_ua),
        polarity=tuple(polarity),
        width_us=100,
        rate_hz=60.0,
        allow_slower=True,
    )
    plan = planner(site=BALANCES).plan(asked, left_uc(nc))
    assert "net_charge" not in [reason for _, reason in told(plan)]
    is_as_asked = [PHASES[polarity[it.electrode]] for it in plan.schedule] == phases(plan)
    assert is_as_asked == ("balanced" not in [reason for _, reason in told(plan)])
