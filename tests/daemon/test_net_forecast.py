"""How long a frame of one polarity can be shown, against its pulses counted one by one."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_parts import frame, planner, site_with
from etd.planning.outlook import Outlook
from etd.planning.plan import Plan, Planner
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity
from etd.protocol.outcome import Shortfall
from etd.safety.net_charge import NetCharge, NetState

N = 16
BOUND_PC = 10_000_000


def lasting(plan: Plan) -> Shortfall | None:
    found = [it for it in plan.slowed if it.reason == "net_charge"]
    return found[0] if found else None


def shows(plan: Plan, seconds: float, left_pc: float, on: int) -> float | None:
    """When an electrode passes the bound, each pulse counted; None: not by then."""
    net = NetCharge(N, BOUND_PC)
    net.add(on, left_pc, None, 0)
    period_ns = plan.period_ns
    for number in range(int(seconds * 1e9) // period_ns + 1):
        for place, scheduled in enumerate(plan.schedule):
            at_ns = number * period_ns + place * 500_000
            request = scheduled.request
            way = 0 if len(scheduled.phases) == 2 else 1 if scheduled.phases[0] else -1
            net.add(scheduled.electrode, way * request.charge_pc, scheduled.returns, at_ns)
            if max(map(abs, net.all(at_ns))) > BOUND_PC:
                return at_ns / 1e9
    return None


def outlook(net_pc: list[float]) -> Outlook:
    return Outlook(lambda path: path, 3_000, {}, [True] * N, net=[NetState([1.0] * N, net_pc)])


currents_ua = st.lists(
    st.sampled_from([0, 0, 0, 500, 1_500, 2_500]), min_size=N, max_size=N
).filter(any)
ways = st.lists(st.sampled_from(["anodic", "cathodic", "biphasic"]), min_size=N, max_size=N)


@settings(max_examples=60)
@given(currents_ua, ways, st.sampled_from([30.0, 60.0]), st.floats(-8e6, 8e6))
def test_it_is_told_how_long_and_no_pulse_before_that_passes_the_bound(
    wanted_ua: list[int], polarity: list[Polarity], rate_hz: float, left_pc: float
) -> None:
    on = wanted_ua.index(max(wanted_ua))
    before = NetCharge(N, BOUND_PC)
    before.add(on, left_pc, None, 0)
    plan = planner().plan(
        frame(
            current_ua=tuple(wanted_ua),
            polarity=tuple(polarity),
            width_us=100,
            rate_hz=rate_hz,
            ttl_ms=1,
            allow_slower=True,
        ),
        outlook(before.all(0)),
    )
    told = lasting(plan)
    passed_s = shows(plan, 6.0, left_pc, on)
    if told is None:
        assert passed_s is None
    elif passed_s is not None:
        assert told.lasts_ms is not None
        assert told.lasts_ms / 1e3 <= passed_s


def one_at(current_ua: int, electrode: int = 3) -> tuple[int, ...]:
    return tuple(current_ua if at == electrode else 0 for at in range(N))


def planned(made: Planner, **fields: object) -> Plan:
    return made.plan(frame(**{"width_us": 100, "rate_hz": 60.0, **fields}))


def test_a_frame_that_asks_for_longer_is_refused_with_what_would_last() -> None:
    """2.4 mA, 100 us, 60 Hz: 14.4 uA, so that 10 uC are there after 1.1 s."""
    made = planner()
    plan = planned(made, current_ua=one_at(2_400), ttl_ms=1_000)
    told = lasting(plan)
    assert told is not None
    assert told.electrode == 3
    exact_s = math.log(14.4 / (14.4 - (10 - 0.24)))
    assert told.lasts_ms == int(1e3 * exact_s)
    assert told.lasting_hz == pytest.approx(0.8 * 60 * 9.76 / 14.4, abs=0.1)
    filled = NetCharge(N, BOUND_PC)
    filled.add(3, 9e6, None, 0)
    with pytest.raises(Refused) as refusal:
        made.plan(
            frame(current_ua=one_at(2_400), width_us=100, rate_hz=60.0, ttl_ms=1_000),
            outlook(filled.all(0)),
        )
    assert refusal.value.code == "over_maximum"
    assert refusal.value.electrode == 3
    assert 'polarity="biphasic"' in refusal.value.reason
    assert f"rate_hz={told.lasting_hz:.1f} lasts" in refusal.value.reason
    assert "what moves can go on" in refusal.value.reason


def test_a_frame_at_the_lasting_rate_lasts() -> None:
    made = planner()
    told = lasting(planned(made, current_ua=one_at(2_400)))
    assert told is not None
    assert lasting(planned(made, current_ua=one_at(2_400), rate_hz=told.lasting_hz)) is None


def test_a_few_pulses_are_shown_however_strong_they_would_be_for_ever() -> None:
    filled = NetCharge(N, BOUND_PC)
    filled.add(3, 6e6, None, 0)
    asked = frame(current_ua=one_at(2_400), width_us=100, rate_hz=60.0, ttl_ms=1_000, pulses=2)
    assert planner().plan(asked, outlook(filled.all(0))).schedule


@pytest.mark.parametrize("polarity", ["biphasic", "biphasic_cathodic_first"])
def test_biphasic_pulses_leave_nothing(polarity: Polarity) -> None:
    assert lasting(planned(planner(), current_ua=one_at(2_000), polarity=polarity)) is None


def test_all_electrodes_alike_leave_nothing() -> None:
    plan = planned(planner(), current_ua=(2_400,) * N, allow_slower=True)
    assert lasting(plan) is None


def test_cathodic_pulses_leave_as_much_and_a_named_return_gets_it_all() -> None:
    made = planner()
    told = lasting(planned(made, current_ua=one_at(2_400), polarity="cathodic"))
    assert told == lasting(planned(made, current_ua=one_at(2_400)))
    each: list[tuple[int, ...]] = [((at + 1) % N,) for at in range(N)]
    each[5] = (4,)
    currents = tuple(1_600 if at in (3, 5) else 0 for at in range(N))
    named = lasting(planned(made, current_ua=currents, returns=tuple(each)))
    assert named is not None
    # 4 is no electrode of the frame: it carries both back.
    assert named.electrode == 4


def test_a_site_says_how_much() -> None:
    less = planner(site=site_with(net_charge_nc=2_000))
    told = lasting(planned(less, current_ua=one_at(1_000), ttl_ms=100))
    assert told is not None
    assert lasting(planned(planner(), current_ua=one_at(1_000))) is None
