"""Contact and resistance from the voltage at the end of a pulse."""

from __future__ import annotations

import pytest

from engine_parts import board_file, body_site
from etd.engine.contact import ContactMap

#: 300 uA across a leak of 66 k and nothing else.
OPEN_V = 19.8
TOUCHED_V = 8.5


def contact_map(electrodes: int = 4) -> ContactMap:
    return ContactMap(electrodes, board_file().source, body_site().contact)


def test_what_no_pulse_has_visited_is_unknown() -> None:
    contact = contact_map()
    assert contact.is_touched == [None] * 4
    assert contact.resistance_ohm == [None] * 4
    assert contact.voltage_v == [None] * 4


def test_the_open_circuit_signature_is_no_contact() -> None:
    contact = contact_map()
    assert not contact.learn(1, 300, OPEN_V)
    assert contact.is_touched == [None, False, None, None]


def test_a_voltage_well_below_the_signature_is_contact() -> None:
    contact = contact_map()
    contact.learn(1, 300, TOUCHED_V)
    assert contact.is_touched[1] is True
    assert contact.voltage_v[1] == TOUCHED_V


@pytest.mark.parametrize(("fraction", "first"), [(0.79, True), (0.81, False), (0.93, False)])
def test_an_unknown_electrode_is_touched_only_below_the_touch_fraction(
    fraction: float, first: bool
) -> None:
    contact = contact_map()
    contact.learn(0, 300, fraction * OPEN_V)
    assert contact.is_touched[0] is first


@pytest.mark.parametrize("before", [True, False])
def test_between_the_fractions_nothing_changes(before: bool) -> None:
    contact = contact_map()
    contact.learn(0, 300, TOUCHED_V if before else OPEN_V)
    contact.learn(0, 300, 0.86 * OPEN_V)
    assert contact.is_touched[0] is before


def test_contact_is_lost_above_the_open_fraction_only() -> None:
    contact = contact_map()
    contact.learn(0, 300, TOUCHED_V)
    contact.learn(0, 300, 0.91 * OPEN_V)
    assert contact.is_touched[0] is True
    contact.learn(0, 300, 0.93 * OPEN_V)
    assert contact.is_touched[0] is False


def test_only_an_electrode_known_to_be_open_is_touched_again() -> None:
    contact = contact_map()
    assert not contact.learn(0, 300, TOUCHED_V)
    assert not contact.learn(0, 300, OPEN_V)
    assert contact.learn(0, 300, TOUCHED_V)
    assert not contact.learn(0, 300, TOUCHED_V)


def test_the_signature_of_a_strong_current_is_the_compliance() -> None:
    contact = contact_map()
    contact.learn(0, 8_000, 300.0)
    contact.learn(1, 8_000, 200.0)
    assert contact.is_touched[:2] == [False, True]


def test_no_current_tells_nothing() -> None:
    contact = contact_map()
    assert not contact.learn(0, 0, 0.0)
    assert contact.is_touched[0] is None
    assert contact.voltage_v[0] is None


def test_resistance_is_told_with_the_leak_taken_out() -> None:
    contact = contact_map()
    skin_ohm, leak_ohm = 50_000, 66_000
    node_v = 1_000e-6 * skin_ohm * leak_ohm / (skin_ohm + leak_ohm)
    contact.learn(0, 1_000, node_v)
    assert contact.resistance_ohm[0] == pytest.approx(skin_ohm, rel=0.001)


@pytest.mark.parametrize(("told_ua", "node_v"), [(300, 19.6), (8_000, 286.0)])
def test_where_the_leak_takes_all_or_the_source_is_at_its_end_there_is_no_resistance(
    told_ua: int, node_v: float
) -> None:
    contact = contact_map()
    contact.learn(0, told_ua, node_v)
    assert contact.resistance_ohm[0] is None


def test_forgetting_leaves_everything_unknown() -> None:
    contact = contact_map()
    for electrode in range(4):
        contact.learn(electrode, 300, TOUCHED_V)
    contact.forget()
    assert contact.is_touched == [None] * 4
    assert contact.resistance_ohm == [None] * 4
    assert contact.voltage_v == [None] * 4
    assert not contact.learn(0, 300, TOUCHED_V)


# --- the state of a contact ---------------------------------------------------------------------

MS = 1_000_000
SOFTEN_MS = 300


def at(contact: ContactMap, skin_ohm: float, now_ms: int, told_ua: int = 2_000) -> None:
    """One pulse on skin of so much, beside the leak."""
    node_v = min(told_ua / 1e6 / (1 / skin_ohm + 1 / 66_000), 300.0)
    contact.learn(0, told_ua, node_v, now_ms * MS)


def test_a_contact_that_was_always_there_is_closed() -> None:
    contact = contact_map()
    assert contact.state(0, 0) == "unknown"
    at(contact, 50_000, 0)
    assert contact.state(0, MS) == "closed"


def test_a_contact_made_anew_is_soft_for_a_while() -> None:
    contact = contact_map()
    at(contact, 1e9, 0)
    assert contact.state(0, 0) == "open"
    at(contact, 50_000, 100)
    assert contact.state(0, 100 * MS) == "soft"
    assert contact.firmness(0, (100 + SOFTEN_MS // 2) * MS) == pytest.approx(0.5)
    assert contact.state(0, (100 + SOFTEN_MS) * MS) == "closed"


def test_a_resistance_that_rises_by_half_from_pulse_to_pulse_is_peeling() -> None:
    contact = contact_map()
    at(contact, 50_000, 0)
    at(contact, 74_000, 16)
    assert contact.state(0, 16 * MS) == "closed"
    at(contact, 112_000, 32)
    assert contact.state(0, 32 * MS) == "soft"


def test_a_weaker_pulse_that_reads_higher_is_no_peeling() -> None:
    contact = contact_map()
    at(contact, 50_000, 0, told_ua=2_000)
    at(contact, 100_000, 16, told_ua=1_000)
    assert contact.state(0, 16 * MS) == "closed"


def test_a_pulse_at_the_compliance_is_saturated_until_one_is_delivered() -> None:
    contact = contact_map()
    contact.learn(0, 6_000, 299.0, 0)
    assert contact.state(0, 0) == "saturated"
    assert contact.undelivered_ua[0] == 6_000
    contact.learn(0, 6_000, 280.0, 16 * MS)
    assert contact.state(0, 16 * MS) == "saturated", "not yet below the lower bound"
    contact.learn(0, 300, TOUCHED_V, 32 * MS)
    assert contact.undelivered_ua[0] is None
    assert contact.state(0, 32 * MS) != "saturated"


def test_a_short_to_a_neighbor_is_told_and_ends_well_above_where_it_began() -> None:
    contact = contact_map()
    at(contact, 1_400, 0)
    assert contact.state(0, 0) == "shorted"
    at(contact, 2_000, 16)
    assert contact.state(0, 16 * MS) == "shorted"
    at(contact, 2_300, 1_000)
    at(contact, 2_300, 2_000)
    assert contact.state(0, 3_000 * MS) == "closed"
