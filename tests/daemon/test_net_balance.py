"""Both phases in place of one, on a body site that balances: what is planned, and what is told."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from calibration_sets import N, made, planner_of
from engine_parts import array, body_site, currents, frame, planner
from etd.planning.net_balance import NetBalance
from etd.planning.net_forecast import NetLimit
from etd.planning.outlook import Outlook
from etd.planning.plan import Plan
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity
from etd.safety.limits import PersonLimits
from etd.safety.net_charge import NetState

BALANCES = msgspec.structs.replace(body_site(), balance="biphasic")
#: 2.4 mA, 100 us, 60 times a second: the bound is reached after 1.1 s.
STRONG: dict[str, Any] = {"current_ua": currents(e3=2_400), "width_us": 100, "rate_hz": 60.0}
LIMIT = NetLimit(3, after_s=0.1, lasting_hz=40.0, shown_s=0.1)


def told(plan: Plan) -> list[tuple[int | None, str]]:
    return [(it.electrode, it.reason) for it in plan.slowed]


def phases(plan: Plan) -> list[tuple[bool, ...]]:
    return [scheduled.phases for scheduled in plan.schedule]


def outlook(left_nc: Sequence[float], conducts_s: Sequence[float] = (1.0,) * N) -> Outlook:
    """By one account."""
    net = [NetState(list(conducts_s), [one * 1e3 for one in left_nc])]
    return Outlook(lambda path: path, 3_000, {}, [True] * N, net=net)


def on_3(nc: float) -> Outlook:
    return outlook([nc if electrode == 3 else 0.0 for electrode in range(N)])


#: At level 1 it has 2.4 mA.
ANODIC = made("anodic", (3_600,) * N)


LEVELS = tuple(1.0 if electrode == 3 else 0.0 for electrode in range(N))


# --- which frames ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("default", "both"), [("anodic", (True, False)), ("cathodic", (False, True))]
)
def test_what_could_not_stand_gets_both_phases_its_own_first_and_is_told(
    default: Polarity, both: tuple[bool, ...]
) -> None:
    defaults = msgspec.structs.replace(BALANCES.defaults, polarity=default)
    site = msgspec.structs.replace(BALANCES, defaults=defaults)
    plan = planner(site=site).plan(frame(**STRONG))
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


@pytest.mark.parametrize("asked", ["anodic", ("anodic",) * N])
def test_who_names_a_polarity_gets_that_one(asked: Polarity | tuple[Polarity, ...]) -> None:
    plans = planner(site=BALANCES)
    plan = plans.plan(frame(**STRONG, polarity=asked))
    assert phases(plan) == [(True,)]
    assert told(plan) == [(3, "net_charge")]
    with pytest.raises(Refused, match=r"with lower currents \(over_maximum\)$"):
        plans.plan(frame(**STRONG, polarity=asked), on_3(9_900.0))


def test_who_asks_for_what_was_sent_or_nothing_gets_no_other_pulses() -> None:
    plans = planner(site=BALANCES)
    plan = plans.plan(frame(**STRONG, strict=True))
    assert phases(plan) == [(True,)]
    assert told(plan) == [(3, "net_charge")]
    with pytest.raises(Refused, match="net charge would be on it"):
        plans.plan(frame(**STRONG, strict=True), on_3(9_900.0))


def test_so_many_pulses_as_stay_within_the_bound_are_left_as_they_are() -> None:
    """However much is left of others: they are refused then, and not felt otherwise."""
    plans = planner(site=BALANCES)
    assert phases(plans.plan(frame(**STRONG, pulses=5))) == [(True,)]
    with pytest.raises(Refused, match="net charge would be on it"):
        plans.plan(frame(**STRONG, pulses=5), on_3(9_900.0))
    less = msgspec.structs.replace(
        BALANCES, maxima=msgspec.structs.replace(BALANCES.maxima, net_charge_nc=600)
    )
    assert phases(planner(site=less).plan(frame(**STRONG, pulses=5))) == [(True, False)]


def test_as_many_pulses_as_reach_the_bound_and_do_not_pass_it_are_left_as_they_are() -> None:
    balance = NetBalance("biphasic", PersonLimits((3_000,) * N, 200, 200, None))
    five = frame(**STRONG, pulses=5)
    assert balance.form_of(five, LIMIT, "anodic") is None
    more = NetLimit(3, after_s=0.099, lasting_hz=40.0, shown_s=0.1)
    both = balance.form_of(five, more, "anodic")
    assert both is not None
    assert (both.polarity, both.pulses) == ("biphasic", 5)


def test_both_phases_without_a_calibration_for_them_are_refused() -> None:
    balance = NetBalance("biphasic", PersonLimits((3_000,) * N, 200, 200, ANODIC))
    with pytest.raises(Refused) as refused:
        balance.form_of(frame(**STRONG), LIMIT, "anodic")
    assert refused.value.code == "bad_calibration"


def test_what_has_both_phases_by_default_is_left_as_it_is() -> None:
    """Its probes may leave something."""
    balance = NetBalance("biphasic", PersonLimits((3_000,) * N, 200, 200, None))
    for polarity in ("biphasic", "biphasic_cathodic_first"):
        assert balance.form_of(frame(**STRONG), LIMIT, polarity) is None


def test_what_the_probes_of_balanced_pulses_leave_is_told() -> None:
    """15 nC of one way, 60 times a second, where the site has a bound of 0.5 uC."""
    site = msgspec.structs.replace(
        BALANCES,
        maxima=msgspec.structs.replace(BALANCES.maxima, net_charge_nc=500),
        stabilize=msgspec.structs.replace(BALANCES.stabilize, probe_first=True),
    )
    plan = planner(site=site).plan(frame(**STRONG))
    assert phases(plan) == [(True, False)]
    assert told(plan) == [(3, "net_charge"), (3, "balanced")]


# --- the same all the time ------------------------------------------------------------------------

wanted = st.lists(st.sampled_from([0, 0, 900, 1_711, 1_793, 2_010]), min_size=N, max_size=N)
conductances = st.lists(st.sampled_from([1.0, 1.3, 4.0, 9.0]), min_size=N, max_size=N)
left = st.lists(st.floats(-9_000.0, 9_000.0), min_size=N, max_size=N)


@settings(max_examples=100)
@given(wanted.filter(any), conductances, left)
@example([1_793 if at % 2 else 0 for at in range(N)], [9.0, *[1.0] * (N - 1)], [0.0] * N)
def test_neither_what_is_left_nor_what_conducts_how_well_decides(
    wanted_ua: list[int], conducts_s: list[float], left_nc: list[float]
) -> None:
    """A frame that is renewed is felt the same all the time, or it is refused."""
    asked = frame(current_ua=tuple(wanted_ua), width_us=100, rate_hz=60.0, allow_slower=True)
    plans = planner(site=BALANCES)
    first = plans.plan(asked)
    again: Plan | None = None
    with contextlib.suppress(Refused):
        again = plans.plan(asked, outlook(left_nc, conducts_s))
    if again is None:
        assert set(phases(first)) == {(True,)}, "both phases leave nothing"
        return
    assert phases(again) == phases(first)
    is_told = any(reason == "balanced" for _, reason in told(first))
    assert is_told == (phases(first)[0] != (True,))


# --- where both phases cannot be had --------------------------------------------------------------


def test_both_phases_have_levels_and_caps_of_their_own_calibration() -> None:
    plans = planner_of(ANODIC, made("biphasic"), site=BALANCES)
    plan = plans.plan(frame(level=LEVELS))
    assert phases(plan) == [(True, False)]
    assert plan.schedule[0].current_ua == 2_000
    assert told(plan) == [(3, "balanced")]


def test_the_polarity_of_frames_that_name_none_is_that_of_the_first_calibration() -> None:
    plans = planner_of(
        *(made(it, (3_600,) * N) for it in ("cathodic", "biphasic_cathodic_first")), site=BALANCES
    )
    assert phases(plans.plan(frame(level=LEVELS))) == [(False, True)]


@pytest.mark.parametrize("asked", [{"level": LEVELS}, {"current_ua": currents(e3=2_400)}])
def test_without_a_calibration_for_both_phases_a_frame_is_as_elsewhere(
    asked: dict[str, Any],
) -> None:
    """A cap was accepted for the pulses that it was found with."""
    plans = planner_of(ANODIC, site=BALANCES)
    plan = plans.plan(frame(**asked))
    assert phases(plan) == [(True,)]
    assert told(plan) == [(3, "net_charge")]
    with pytest.raises(Refused) as refused:
        plans.plan(frame(**asked), on_3(9_900.0))
    assert refused.value.code == "over_maximum"
    assert "of net charge would be on it" in refused.value.reason
    assert refused.value.reason.endswith(
        ". It cannot be balanced here: there is no calibration for polarity biphasic"
    )


@pytest.mark.parametrize(
    ("name", "asked", "why"),
    [
        # 60 of 64, whose current the other four carry back: of one phase it lasts for 6 s.
        (
            "grid-8x8",
            {"current_ua": (*(4 * (0,)), *(60 * (2_700,))), "rate_hz": 38.0},
            "60 electrodes at 38 Hz do not fit",
        ),
        ("grid-4x4", {"current_ua": currents(e3=2_700), "rate_hz": 60.0}, "mean current"),
    ],
)
def test_where_both_phases_do_not_fit_a_frame_is_as_elsewhere(
    name: str, asked: dict[str, Any], why: str
) -> None:
    layout = array(name)
    asked = {"width_us": 100, **asked}
    plans = planner(site=BALANCES, layout=layout)
    plan = plans.plan(frame(**asked))
    assert set(phases(plan)) == {(True,)}
    assert [reason for _, reason in told(plan)] == ["net_charge"]
    full = [NetState([1.0] * layout.count, [-9.9e6 if it == 0 else 9.5e6 for it in range(64)])]
    full = [NetState(state.conducts_s, state.left_pc[: layout.count]) for state in full]
    with pytest.raises(Refused) as refused:
        plans.plan(
            frame(**asked), Outlook(lambda path: path, 3_000, {}, [True] * layout.count, net=full)
        )
    assert refused.value.code == "over_maximum"
    assert "It cannot be balanced here: " in refused.value.reason
    assert why in refused.value.reason
