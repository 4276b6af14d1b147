"""The minimal body against the formulas it claims to follow."""

from __future__ import annotations

from math import exp, log

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_body.electrode import (
    DRY_CAPACITANCE_NF,
    DRY_PARALLEL_OHM,
    DRY_SERIES_OHM,
    OPEN_CONTACT,
    SHORTED_CONTACT,
    Contact,
    dry_fingertip,
    grounded,
    load,
    skin,
)
from etd_body.interface import Body, Side, Sides
from etd_body.minimal import MinimalBody

LEAK_OHM = 66_000
COMPLIANCE_V = 300.0
US = 1_000


def body_of(*contacts: Contact, compliance_v: float = COMPLIANCE_V) -> MinimalBody:
    return MinimalBody(contacts, leak_ohm=LEAK_OHM, compliance_v=compliance_v)


def one_against(count: int, electrode: int = 0, direction: Side = Side.SOURCE) -> Sides:
    other = Side.GROUND if direction is Side.SOURCE else Side.SOURCE
    return tuple(direction if index == electrode else other for index in range(count))


def all_on(side: Side, count: int) -> Sides:
    return (side,) * count


def test_the_minimal_body_is_a_body() -> None:
    body: Body = body_of(skin())
    assert body.electrode_count == 1


def test_nothing_connected_reads_as_current_times_leak() -> None:
    body = body_of(skin(), skin())
    body.drive(0, 1_000, all_on(Side.GROUND, 2))
    assert body.node_voltage_v(50 * US) == pytest.approx(66.0)


def test_nothing_connected_reads_as_the_compliance_when_that_is_lower() -> None:
    body = body_of(skin(), skin())
    body.drive(0, 8_000, all_on(Side.GROUND, 2))
    assert body.node_voltage_v(50 * US) == COMPLIANCE_V


def test_a_load_shares_the_current_with_the_leak() -> None:
    body = body_of(load(33_000), load(1.0))
    body.drive(0, 3_000, one_against(2))
    expected_v = 3e-3 * LEAK_OHM * 33_001 / (LEAK_OHM + 33_001)
    assert body.node_voltage_v(10 * US) == pytest.approx(expected_v)
    assert body.charge_pc(0) == pytest.approx(expected_v / 33_001 * 10e-6 * 1e12)


def test_skin_follows_the_step_response_of_its_circuit() -> None:
    body = body_of(skin(), load(1.0))
    body.drive(0, 2_000, one_against(2))
    loop_ohm = LEAK_OHM + DRY_SERIES_OHM + 1.0
    thevenin_v = 2e-3 * LEAK_OHM
    tau_s = DRY_CAPACITANCE_NF * 1e-9 / (1 / loop_ohm + 1 / DRY_PARALLEL_OHM)
    final_v = thevenin_v * DRY_PARALLEL_OHM / (loop_ohm + DRY_PARALLEL_OHM)
    for t_us in (1, 10, 35, 100):
        held_v = final_v * (1 - exp(-t_us * 1e-6 / tau_s))
        current_a = (thevenin_v - held_v) / loop_ohm
        expected_v = current_a * (DRY_SERIES_OHM + 1.0) + held_v
        assert body.node_voltage_v(t_us * US) == pytest.approx(expected_v, rel=1e-9)


def test_charge_is_the_integral_of_the_current() -> None:
    body = body_of(skin(), load(1.0))
    body.drive(0, 5_000, one_against(2))
    step_ns = 50
    summed_pc = 0.0
    for t_ns in range(0, 100 * US, step_ns):
        node_v = body.node_voltage_v(t_ns + step_ns // 2)
        current_a = min(5e-3 - node_v / LEAK_OHM, 5e-3)
        summed_pc += current_a * step_ns * 1e-9 * 1e12
    body.node_voltage_v(100 * US)
    assert body.charge_pc(0) == pytest.approx(summed_pc, rel=1e-4)


def test_the_node_stops_at_the_compliance_at_the_computed_instant() -> None:
    body = body_of(skin(), load(1.0), compliance_v=150.0)
    body.drive(0, 6_000, one_against(2))
    series_ohm = DRY_SERIES_OHM + 1.0
    loop_ohm = LEAK_OHM + series_ohm
    thevenin_v = 6e-3 * LEAK_OHM
    tau_s = DRY_CAPACITANCE_NF * 1e-9 / (1 / loop_ohm + 1 / DRY_PARALLEL_OHM)
    final_v = thevenin_v * DRY_PARALLEL_OHM / (loop_ohm + DRY_PARALLEL_OHM)
    held_v = (150.0 * loop_ohm - thevenin_v * series_ohm) / LEAK_OHM
    crossing_ns = round(-tau_s * log(1 - held_v / final_v) * 1e9)
    assert 0 < crossing_ns < 50 * US
    assert body.node_voltage_v(crossing_ns - 100) < 150.0
    assert body.node_voltage_v(crossing_ns + 100) == pytest.approx(150.0)
    assert body.node_voltage_v(100 * US) == pytest.approx(150.0)


def test_beyond_the_compliance_less_is_delivered_than_asked() -> None:
    asked, got = [], []
    for compliance_v in (100.0, 300.0):
        body = body_of(skin(), load(1.0), compliance_v=compliance_v)
        body.drive(0, 5_000, one_against(2))
        body.node_voltage_v(100 * US)
        asked.append(5_000 * 100)
        got.append(body.charge_pc(0))
    assert got[0] < 0.8 * got[1] < 0.8 * asked[1]


def test_a_supply_that_is_off_delivers_nothing() -> None:
    body = body_of(skin(), skin(), compliance_v=0.0)
    body.drive(0, 5_000, one_against(2))
    assert body.node_voltage_v(100 * US) == 0.0
    assert body.charge_pc(0) == 0.0


@pytest.mark.parametrize("direction", [Side.SOURCE, Side.GROUND])
def test_charge_is_positive_into_the_skin_on_the_source_side(direction: Side) -> None:
    body = body_of(*dry_fingertip(8, seed=3))
    body.drive(0, 2_000, one_against(8, 5, direction))
    body.node_voltage_v(100 * US)
    sign = 1 if direction is Side.SOURCE else -1
    assert body.charge_pc(5) * sign > 0
    assert body.charge_pc(4) * sign < 0


def test_returns_share_the_charge_by_their_conductance() -> None:
    body = body_of(load(1_000), load(10_000), load(30_000))
    body.drive(0, 1_000, one_against(3))
    body.node_voltage_v(100 * US)
    assert body.charge_pc(1) == pytest.approx(3 * body.charge_pc(2))


def test_an_open_electrode_takes_no_part() -> None:
    body = body_of(skin(), OPEN_CONTACT, skin())
    body.drive(0, 1_000, (Side.SOURCE, Side.GROUND, Side.OPEN))
    assert body.node_voltage_v(100 * US) == pytest.approx(66.0)
    assert body.charge_pc(0) == 0.0


def test_a_shorted_electrode_reads_far_below_skin() -> None:
    body = body_of(SHORTED_CONTACT, *dry_fingertip(63, seed=1))
    body.drive(0, 1_000, one_against(64))
    assert body.node_voltage_v(100 * US) < 5.0


def test_discharge_takes_back_what_the_capacitor_holds() -> None:
    body = body_of(*dry_fingertip(64, seed=1))
    body.drive(0, 3_000, one_against(64))
    body.drive(100 * US, 0, all_on(Side.GROUND, 64))
    body.node_voltage_v(100 * US)
    after_pulse_pc = body.charge_pc(0)
    body.node_voltage_v(400 * US)
    assert body.charge_pc(0) < after_pulse_pc
    body.drive(400 * US, 0, one_against(64))
    assert body.node_voltage_v(400 * US) == pytest.approx(0.0, abs=0.1)


def test_charge_stays_on_an_electrode_that_is_left_open() -> None:
    body = body_of(skin(parallel_ohm=1e9), load(1_000.0))
    body.drive(0, 1_000, one_against(2))
    body.drive(20 * US, 0, all_on(Side.OPEN, 2))
    held_pc = body.charge_pc(0)
    body.drive(200 * US, 0, one_against(2))
    assert body.charge_pc(0) == held_pc
    assert body.node_voltage_v(200 * US) > 1.0


def test_a_new_contact_keeps_the_charge_that_was_booked() -> None:
    body = body_of(*dry_fingertip(4, seed=1))
    body.drive(0, 1_000, one_against(4))
    body.node_voltage_v(50 * US)
    before = [body.charge_pc(electrode) for electrode in range(4)]
    body.touch(50 * US, 2, OPEN_CONTACT)
    assert [body.charge_pc(electrode) for electrode in range(4)] == pytest.approx(before)


def test_several_on_each_side_share_as_two_resistances() -> None:
    body = body_of(load(2_000), load(2_000), load(6_000), load(6_000))
    body.drive(0, 1_000, (Side.SOURCE, Side.SOURCE, Side.GROUND, Side.GROUND))
    assert body.node_voltage_v(100 * US) == pytest.approx(
        1e-3 * LEAK_OHM * 4_000 / (LEAK_OHM + 4_000)
    )
    assert body.charge_pc(0) == pytest.approx(body.charge_pc(1))
    assert body.charge_pc(0) == pytest.approx(-body.charge_pc(2))


def test_time_that_goes_back_is_refused() -> None:
    body = body_of(skin(), skin())
    body.drive(100, 0, all_on(Side.GROUND, 2))
    with pytest.raises(ValueError, match="went back"):
        body.node_voltage_v(99)


STEPS = st.lists(
    st.tuples(
        st.integers(0, 300_000),
        st.floats(0, 10_000),
        st.lists(st.sampled_from(Side), min_size=6, max_size=6).map(tuple),
        st.sampled_from([0.0, 5.0, 60.0, 300.0]),
    ),
    max_size=12,
)


@given(STEPS)
def test_whatever_is_driven_no_charge_is_made_and_the_node_stays_within_bounds(
    steps: list[tuple[int, float, Sides, float]],
) -> None:
    body = body_of(*dry_fingertip(4, seed=2), OPEN_CONTACT, load(20_000))
    t_ns = 0
    for duration_ns, source_ua, sides, compliance_v in steps:
        body.supply(t_ns, compliance_v)
        body.drive(t_ns, source_ua, sides)
        t_ns += duration_ns
        assert -COMPLIANCE_V <= body.node_voltage_v(t_ns) <= COMPLIANCE_V + 1e-6
    charges = [body.charge_pc(electrode) for electrode in range(6)]
    largest_pc = sum(body.absolute_charge_pc(electrode) for electrode in range(6))
    assert sum(charges) == pytest.approx(0.0, abs=1e-6 + 1e-9 * largest_pc)


@given(st.floats(0, 10_000), st.integers(1, 200_000), st.floats(1, 300))
def test_the_skin_never_gets_more_than_the_source_was_told(
    source_ua: float, width_ns: int, compliance_v: float
) -> None:
    body = body_of(*dry_fingertip(16, seed=4), compliance_v=compliance_v)
    body.drive(0, source_ua, one_against(16))
    body.node_voltage_v(width_ns)
    commanded_pc = source_ua * width_ns / 1_000
    assert -1e-6 <= body.charge_pc(0) <= commanded_pc * (1 + 1e-9) + 1e-6


@pytest.mark.parametrize("side", [Side.SOURCE, Side.GROUND])
def test_a_resistor_to_ground_loads_the_node_from_the_source_alone(side: Side) -> None:
    """And whatever is on the other side: it has no way into the tissue."""
    body = body_of(grounded(47_000.0), skin(), OPEN_CONTACT)
    body.drive(0, 1_000, one_against(3, 0, side))
    both_ohm = 1 / (1 / 47_000 + 1 / LEAK_OHM)
    expected_v = both_ohm / 1_000 if side is Side.SOURCE else 66.0
    assert body.node_voltage_v(50 * US) == pytest.approx(expected_v)
    assert body.absolute_charges_pc() == [0.0, 0.0, 0.0]


def test_a_resistor_to_ground_may_come_and_go_under_a_standing_selection() -> None:
    body = body_of(OPEN_CONTACT, skin())
    body.drive(0, 1_000, one_against(2))
    for contact, volts in ((grounded(66_000.0), 33.0), (OPEN_CONTACT, 66.0)):
        body.touch(10 * US, 0, contact)
        assert body.node_voltage_v(20 * US) == pytest.approx(volts)
        body = body_of(contact, skin())
        body.drive(0, 1_000, one_against(2))
