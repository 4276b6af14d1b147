"""Contact and resistance from the voltage at the end of a pulse."""

from __future__ import annotations

import msgspec
import pytest

from engine_parts import board_file, body_site
from etd.pulse.measured import MAX_AGE_NS
from etd.sensing.contact import ContactMap

MS = 1_000_000
SOFTEN_MS = 300
#: 300 uA across a leak of 66 k and nothing else.
OPEN_V = 19.8
TOUCHED_V = 8.5


def contact_map(electrodes: int = 4) -> ContactMap:
    site = msgspec.structs.replace(body_site().contact, soften_ms=SOFTEN_MS)
    return ContactMap(electrodes, board_file().source, site)


def test_what_no_pulse_has_visited_is_unknown() -> None:
    contact = contact_map()
    assert contact.is_touched == [None] * 4
    assert contact.resistance_ohm == [None] * 4
    assert contact.voltage_v == [None] * 4


def test_the_open_circuit_signature_is_no_contact() -> None:
    contact = contact_map()
    assert not contact.update(1, 300, OPEN_V)
    assert contact.is_touched == [None, False, None, None]


def test_a_voltage_well_below_the_signature_is_contact() -> None:
    contact = contact_map()
    contact.update(1, 300, TOUCHED_V)
    assert contact.is_touched[1] is True
    assert contact.voltage_v[1] == TOUCHED_V


@pytest.mark.parametrize(("fraction", "first"), [(0.79, True), (0.81, False), (0.93, False)])
def test_an_unknown_electrode_is_touched_only_below_the_touch_fraction(
    fraction: float, first: bool
) -> None:
    contact = contact_map()
    contact.update(0, 300, fraction * OPEN_V)
    assert contact.is_touched[0] is first


@pytest.mark.parametrize("before", [True, False])
def test_between_the_fractions_nothing_changes(before: bool) -> None:
    contact = contact_map()
    contact.update(0, 300, TOUCHED_V if before else OPEN_V)
    contact.update(0, 300, 0.86 * OPEN_V)
    assert contact.is_touched[0] is before


def test_contact_is_lost_above_the_open_fraction_only() -> None:
    contact = contact_map()
    contact.update(0, 300, TOUCHED_V)
    contact.update(0, 300, 0.91 * OPEN_V)
    assert contact.is_touched[0] is True
    contact.update(0, 300, 0.93 * OPEN_V)
    assert contact.is_touched[0] is False


def test_only_an_electrode_known_to_be_open_is_touched_again() -> None:
    contact = contact_map()
    assert not contact.update(0, 300, TOUCHED_V)
    assert not contact.update(0, 300, OPEN_V)
    assert contact.update(0, 300, TOUCHED_V)
    assert not contact.update(0, 300, TOUCHED_V)


def test_the_signature_of_a_strong_current_is_the_compliance() -> None:
    contact = contact_map()
    contact.update(0, 8_000, 300.0)
    contact.update(1, 8_000, 200.0)
    assert contact.is_touched[:2] == [False, True]


def test_no_current_tells_nothing() -> None:
    contact = contact_map()
    assert not contact.update(0, 0, 0.0)
    assert contact.is_touched[0] is None
    assert contact.voltage_v[0] is None


def test_resistance_is_told_with_the_leak_taken_out() -> None:
    contact = contact_map()
    skin_ohm, leak_ohm = 50_000, 66_000
    node_v = 1_000e-6 * skin_ohm * leak_ohm / (skin_ohm + leak_ohm)
    contact.update(0, 1_000, node_v)
    assert contact.resistance_ohm[0] == pytest.approx(skin_ohm, rel=0.001)


@pytest.mark.parametrize(("commanded_ua", "node_v"), [(300, 19.6), (8_000, 286.0)])
def test_where_the_leak_takes_all_or_the_source_is_at_its_end_there_is_no_resistance(
    commanded_ua: int, node_v: float
) -> None:
    contact = contact_map()
    contact.update(0, commanded_ua, node_v)
    assert contact.resistance_ohm[0] is None


def test_forgetting_leaves_everything_unknown() -> None:
    contact = contact_map()
    for electrode in range(4):
        contact.update(electrode, 300, TOUCHED_V)
    contact.reset()
    assert contact.is_touched == [None] * 4
    assert contact.resistance_ohm == [None] * 4
    assert contact.voltage_v == [None] * 4
    assert not contact.update(0, 300, TOUCHED_V)


# --- the state of a contact ---------------------------------------------------------------------


def at(contact: ContactMap, skin_ohm: float, now_ms: int, commanded_ua: int = 2_000) -> None:
    """One pulse on skin of so much, beside the leak."""
    node_v = min(commanded_ua / 1e6 / (1 / skin_ohm + 1 / 66_000), 300.0)
    contact.update(0, commanded_ua, node_v, now_ms * MS)


def lying(skin_ohm: float, until_ms: int, commanded_ua: int = 2_000) -> ContactMap:
    """A contact that was there for as long as it takes to be closed."""
    contact = contact_map()
    for now_ms in range(until_ms - 3_200, until_ms + 1, 800):
        at(contact, skin_ohm, now_ms, commanded_ua)
    return contact


def test_a_contact_is_soft_at_first_and_then_closed() -> None:
    contact = contact_map()
    assert contact.state(0, 0) == "unknown"
    at(contact, 50_000, 0)
    assert contact.state(0, MS) == "soft"
    assert contact.state(0, SOFTEN_MS * MS) == "closed"


def test_a_contact_made_anew_is_soft_for_a_while() -> None:
    contact = contact_map()
    at(contact, 1e9, 0)
    assert contact.state(0, 0) == "open"
    at(contact, 50_000, 100)
    assert contact.state(0, 100 * MS) == "soft"
    assert contact.firmness(0, (100 + SOFTEN_MS // 2) * MS) == pytest.approx(0.5)
    assert contact.state(0, (100 + SOFTEN_MS) * MS) == "closed"


def test_a_resistance_that_rises_by_half_from_pulse_to_pulse_is_peeling() -> None:
    contact = lying(50_000, 0)
    at(contact, 74_000, 16)
    assert contact.state(0, 16 * MS) == "closed"
    at(contact, 112_000, 32)
    assert contact.state(0, 32 * MS) == "soft"


def test_a_weaker_pulse_that_reads_higher_is_no_peeling() -> None:
    contact = lying(50_000, 0)
    at(contact, 100_000, 16, commanded_ua=1_000)
    assert contact.state(0, 16 * MS) == "closed"


def test_a_pulse_at_the_compliance_is_saturated_until_one_is_delivered() -> None:
    contact = contact_map()
    contact.update(0, 6_000, 299.0, 0)
    assert contact.state(0, 0) == "saturated"
    assert contact.undelivered_ua[0] == 6_000
    contact.update(0, 6_000, 280.0, 16 * MS)
    assert contact.state(0, 16 * MS) == "saturated", "not yet below the lower bound"
    contact.update(0, 300, TOUCHED_V, 32 * MS)
    assert contact.undelivered_ua[0] is None
    assert contact.state(0, 32 * MS) != "saturated"


def test_a_short_to_a_neighbor_is_told_and_ends_well_above_where_it_began() -> None:
    contact = contact_map()
    at(contact, 1_400, 0)
    assert contact.state(0, 0) == "shorted"
    at(contact, 2_000, 16)
    assert contact.state(0, 16 * MS) == "shorted"
    at(contact, 2_300, 800)
    assert contact.state(0, 1_600 * MS) == "closed"


# --- and how long it is known -------------------------------------------------------------------

BELIEVED_MS = MAX_AGE_NS // MS


def test_a_contact_that_no_pulse_visits_is_not_known_after_a_second() -> None:
    contact = lying(50_000, 0)
    assert contact.state(0, MAX_AGE_NS - 1) == "closed"
    assert contact.state(0, MAX_AGE_NS) == "unknown"
    assert contact.is_touched[0] is None
    assert contact.resistance_ohm[0] is None
    assert contact.voltage_v[0] is None


def test_a_touch_after_a_pause_is_soft_and_not_one_that_looks_have_followed() -> None:
    paused, looked_at = lying(50_000, 0), lying(50_000, 0)
    for now_ms in range(500, 3_001, 500):
        looked_at.update(0, 300, TOUCHED_V, now_ms * MS)
    for contact in (paused, looked_at):
        at(contact, 50_000, 3_016)
    assert paused.state(0, 3_016 * MS) == "soft"
    assert paused.firmness(0, 3_016 * MS) == 0.0
    assert looked_at.state(0, 3_016 * MS) == "closed"


def test_what_was_found_open_stays_open_until_it_is_touched_again() -> None:
    contact = contact_map()
    at(contact, 1e9, 0)
    assert contact.state(0, 100 * MAX_AGE_NS) == "open"
    assert contact.is_touched[0] is False
    assert contact.update(0, 300, TOUCHED_V, 101 * MAX_AGE_NS), "its own ramp begins"


def test_after_a_pause_hysteresis_begins_anew_on_the_open_side() -> None:
    contact = lying(50_000, 0)
    contact.update(0, 300, 0.86 * OPEN_V, MAX_AGE_NS)
    assert contact.is_touched[0] is False


def test_an_overstrained_or_shorted_contact_is_not_known_after_a_pause_either() -> None:
    contact = contact_map()
    contact.update(0, 6_000, 299.0, 0)
    at_short = contact_map()
    at(at_short, 1_400, 0)
    for one in (contact, at_short):
        assert one.state(0, MAX_AGE_NS) in ("unknown", "open")
    assert contact.undelivered_ua[0] is None
    at(at_short, 2_000, BELIEVED_MS)
    assert at_short.state(0, MAX_AGE_NS) == "soft"


def test_a_rise_over_a_pause_is_no_peeling_but_a_new_contact() -> None:
    contact = lying(50_000, 0)
    at(contact, 120_000, BELIEVED_MS)
    assert contact.state(0, MAX_AGE_NS) == "soft"
    assert contact.state(0, MAX_AGE_NS + SOFTEN_MS * MS) == "closed"


def test_a_contact_that_was_seen_to_be_as_before_is_closed_and_an_open_one_is_not() -> None:
    contact = lying(50_000, 0)
    contact.is_as_before(0, MAX_AGE_NS)
    at(contact, 50_000, BELIEVED_MS)
    assert contact.state(0, MAX_AGE_NS) == "closed"
    at(contact, 1e9, BELIEVED_MS + 16)
    contact.is_as_before(0, 3 * MAX_AGE_NS)
    assert contact.is_touched[0] is False
