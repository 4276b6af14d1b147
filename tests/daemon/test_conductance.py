"""What contacts conduct, by the paths of pulses through them."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from etd.safety.conductance import OwnBounds, Reading, own_bounds
from etd_body.electrode import Contact, load, skin
from path_readings import METER, exact, paths_ohm, sampled
from plain_records import changed

ohms = st.floats(math.log(2e3), math.log(5e5)).map(math.exp)
#: Of dry skin: 1 to 3 k in series, at most 0.5 nF.
contacts = st.one_of(
    ohms.map(load),
    st.builds(skin, st.floats(1e3, 3e3), ohms, st.floats(0.05, 0.5)),
)
pulses = st.tuples(st.sampled_from([60, 100, 300, 3_000]), st.sampled_from([50, 100, 200]))
probes = st.tuples(
    st.sampled_from([100, 300, 1_000]), st.just(20), st.sampled_from([20, 100, 1_000])
)
EVEN = skin(2e3, 48e3, 0.3)


def read(on: list[Contact], current_ua: int, width_us: int) -> list[Reading]:
    found = [
        METER.read(sampled(on, electrode, current_ua, width_us), None)
        for electrode in range(len(on))
    ]
    return [reading for reading in found if reading is not None]


def own(readings: list[Reading], beside_s: float = 0.0) -> OwnBounds:
    return own_bounds(METER, readings, beside_s)


def test_paths_that_are_known_exactly_tell_what_each_contact_conducts() -> None:
    on = [load(152e3)] * 15 + [load(2e3)]
    found = own([exact(ohm) for ohm in paths_ohm(on)])
    for electrode, contact in enumerate(on):
        assert found.least_s[electrode] <= contact.conductance_s <= found.most_s[electrode]
        assert found.least_s[electrode] == pytest.approx(contact.conductance_s, rel=0.03)
        assert found.most_s[electrode] == pytest.approx(contact.conductance_s, rel=0.03)
        back_ohm = paths_ohm(on)[electrode] - contact.resistance_ohm
        assert back_ohm <= found.back_ohm[electrode] * (1.0 + 1e-9)
        assert found.back_ohm[electrode] == pytest.approx(back_ohm, rel=0.03)


def dry(*others: tuple[Contact, tuple[int, int]]) -> list[tuple[Contact, tuple[int, int]]]:
    """Few contacts, which resist so much that the way back makes the rise last longer."""
    return [(load(math.exp(13)), (3_000, 200)), *others]


@settings(deadline=None)
@given(
    st.lists(st.tuples(contacts, pulses), min_size=4, max_size=20),
)
@example(
    dry(
        (load(math.exp(11)), (100, 100)),
        (skin(1_000, math.exp(12), 0.5), (3_000, 200)),
        (skin(1_000, math.exp(13), 0.5), (3_000, 50)),
    )
)
@example(
    dry(
        (load(math.exp(10)), (60, 50)),
        (skin(1_000, math.exp(12), 0.5), (60, 50)),
        (skin(1_000, math.exp(13), 0.5), (300, 50)),
    )
)
def test_whatever_skin_is_read_each_contact_conducts_what_lies_between_the_bounds(
    drawn: list[tuple[Contact, tuple[int, int]]],
) -> None:
    on = [contact for contact, _ in drawn]
    readings = []
    for electrode, (_, (current_ua, width_us)) in enumerate(drawn):
        reading = METER.read(sampled(on, electrode, current_ua, width_us), None)
        assert reading is not None
        readings.append(reading)
    check_bounds(on, readings)


@settings(deadline=None)
@given(st.lists(st.tuples(contacts, pulses, probes), min_size=4, max_size=20))
def test_a_probe_before_the_pulse_makes_no_bound_wrong(
    drawn: list[tuple[Contact, tuple[int, int], tuple[int, int, int]]],
) -> None:
    """It leaves the skin charged: a strong one by more than its pulse reaches."""
    on = [contact for contact, _, _ in drawn]
    readings = []
    for electrode, (_, (current_ua, width_us), probe) in enumerate(drawn):
        samples = sampled(on, electrode, current_ua, width_us, probe=probe)
        readings.append(METER.read(samples, None))
    check_bounds(on, [reading for reading in readings if reading is not None])


def check_bounds(on: list[Contact], readings: list[Reading]) -> None:
    assert len(readings) == len(on)
    found = own(readings)
    for electrode, contact in enumerate(on):
        assert found.least_s[electrode] <= contact.conductance_s * (1 + 1e-9)
        assert contact.conductance_s <= found.most_s[electrode] * (1 + 1e-9)


@pytest.mark.parametrize(
    ("count", "current_ua", "width_us", "wider"),
    [(8, 2_000, 100, 1.02), (16, 2_000, 100, 1.01), (64, 2_000, 100, 1.01), (64, 300, 50, 1.06)],
)
def test_where_all_are_alike_the_share_is_hardly_wider_than_one_part_of_them(
    count: int, current_ua: int, width_us: int, wider: float
) -> None:
    found = own(read([EVEN] * count, current_ua, width_us))
    share = found.most_s[0] / (sum(found.least_s) - found.least_s[1])
    assert 1.0 <= share * (count - 1) <= wider


def test_beside_electrodes_that_are_not_known_no_way_back_is_taken_off_the_most_of_a_path() -> None:
    readings = [exact(ohm) for ohm in paths_ohm([load(50e3)] * 8)]
    alone, beside = own(readings), own(readings, math.inf)
    assert all(value < it for value, it in zip(beside.least_s, alone.least_s, strict=True))
    assert beside.least_s == pytest.approx([1.0 / ohm for ohm in paths_ohm([load(50e3)] * 8)])


def test_a_contact_that_resists_less_than_the_way_back_is_sure_has_no_bound() -> None:
    """The others are read as more than they are, and what is left of its path is nothing."""
    found = own([exact(300e3), exact(300e3), exact(100e3)])
    assert found.most_s[2] == math.inf
    assert found.least_s[2] == pytest.approx(1.0 / 100e3)


def test_a_contact_without_a_bound_is_bounded_by_the_others_and_bounds_none_of_them() -> None:
    vague = changed(exact(100e3), least_ohm=10e3)
    found = own([*[exact(300e3)] * 9, vague])
    assert found.most_s[9] == math.inf
    back_ohm = 1.0 / sum(found.most_s[:9])
    assert found.least_s[9] == pytest.approx(1.0 / (100e3 - back_ohm), rel=0.01)
    assert found.least_s[:9] == pytest.approx([1.0 / 300e3] * 9)


def test_beside_two_contacts_without_a_bound_no_way_back_is_taken_off_any() -> None:
    vague = changed(exact(100e3), least_ohm=10e3)
    found = own([*[exact(300e3)] * 9, vague, vague])
    assert found.most_s[9:] == [math.inf] * 2
    assert found.least_s == pytest.approx([1.0 / 300e3] * 9 + [1.0 / 100e3] * 2)


def test_a_source_at_its_end_tells_the_least_alone() -> None:
    reading = METER.read(sampled([load(500e3)] * 2, 0, 9_000, 100), None)
    assert reading is not None
    assert reading.most_ohm == math.inf
    assert reading.least_ohm < 1e6
    assert own([reading, reading]).least_s == [0.0, 0.0]


# --- pulses that are not whole --------------------------------------------------------------------


def test_a_short_pulse_alone_tells_by_an_assumed_rise() -> None:
    """Skin of 8.5 us: what is assumed at the most is half as long again."""
    found = own(read([EVEN] * 16, 2_000, 20))
    for electrode in range(16):
        assert 0.4 * EVEN.conductance_s < found.least_s[electrode] <= EVEN.conductance_s
        assert EVEN.conductance_s <= found.most_s[electrode] < 2.2 * EVEN.conductance_s


def test_a_pulse_without_a_current_or_behind_a_step_alone_tells_nothing() -> None:
    assert METER.read(sampled([EVEN] * 4, 0, 0, 100), None) is None
    by_short = METER.read(sampled([EVEN] * 4, 0, 2_000, 20), None)
    for width_us in (20, 100):
        led = sampled([EVEN] * 4, 0, 2_000, width_us, has_prepulse=True)
        assert METER.read(led, None) is None
        assert METER.read(led, by_short) is None


@pytest.mark.parametrize(("times", "apart"), [(0.85, 1.3), (1.0, 1.2), (1.2, 1.3)])
def test_a_short_pulse_tells_by_how_much_the_path_has_changed(times: float, apart: float) -> None:
    whole = METER.read(sampled([EVEN] * 16, 0, 2_000, 100), None)
    assert whole is not None
    other = skin(2e3 * times, 48e3 * times, 0.3 / times)
    changed = [other, *[EVEN] * 15]
    short = METER.read(sampled(changed, 0, 2_000, 20), whole)
    assert short is not None
    true_ohm = paths_ohm(changed)[0]
    assert short.least_ohm <= true_ohm <= METER.most_ohm(short, 4e3)
    assert short.most_ohm / short.least_ohm < apart
    again = METER.read(sampled(changed, 0, 2_000, 20), short)
    assert again is not None
    assert again.whole is short.whole is whole.whole


@pytest.mark.parametrize(
    ("before", "now"),
    [
        (skin(1e3, 29_442.0, 0.443), load(1e3)),
        (skin(2e3, 20e3, 0.5), load(2_500)),
        (load(5e3), skin(3e3, 400e3, 0.5)),
    ],
)
def test_a_short_pulse_of_another_contact_is_read_alone(before: Contact, now: Contact) -> None:
    """One that rises otherwise would be taken for a path that resists up to 12 times as much."""
    beside = [EVEN] * 7
    whole = METER.read(sampled([before, *beside], 0, 2_000, 100), None)
    short = METER.read(sampled([now, *beside], 0, 2_000, 20), whole)
    alone = METER.read(sampled([now, *beside], 0, 2_000, 20), None)
    assert whole is not None
    assert short is not None
    assert alone is not None
    assert short.least_ohm == alone.least_ohm <= paths_ohm([now, *beside])[0]
    assert short.whole is not whole.whole


def test_a_pulse_behind_a_step_is_read_by_its_end_alone() -> None:
    whole = METER.read(sampled([EVEN] * 16, 0, 2_000, 100), None)
    assert whole is not None
    behind = METER.read(sampled([EVEN] * 16, 0, 2_000, 100, has_prepulse=True), whole)
    assert behind is not None
    assert behind.least_ohm < paths_ohm([EVEN] * 16)[0] < behind.most_ohm
    assert METER.read(sampled([EVEN] * 16, 0, 2_000, 20, has_prepulse=True), whole) is None


def test_what_was_left_on_the_node_before_a_pulse_is_taken_off_the_least() -> None:
    samples = sampled([EVEN] * 16, 0, 2_000, 100)
    clean = METER.read(samples, None)
    left = METER.read(changed(samples, resting_v=3.0), None)
    assert clean is not None
    assert left is not None
    assert left.least_ohm < clean.least_ohm
    assert left.most_ohm == clean.most_ohm


@settings(deadline=None)
@given(contacts, pulses, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_noise_that_reads_the_rise_backwards_is_no_error(
    contact: Contact, pulse: tuple[int, int], early_by_v: float, last_by_v: float
) -> None:
    samples = sampled([contact, *[EVEN] * 3], 0, *pulse)
    noisy = changed(
        samples, early_v=samples.early_v + early_by_v, last_v=samples.last_v + last_by_v
    )
    reading = METER.read(noisy, None)
    if reading is not None:
        assert METER.most_ohm(reading, 0.0) <= reading.most_ohm


def test_readings_differ_where_neither_bounds_nor_their_currents_can_explain_them() -> None:
    before = changed(exact(100e3, current_ua=1.0), most_ohm=110e3)
    assert not before.differs(before)
    assert not before.differs(changed(before, least_ohm=109e3, most_ohm=150e3))
    assert not before.differs(changed(before, least_ohm=50e3, most_ohm=101e3))
    assert not before.differs(changed(before, least_ohm=110e3, most_ohm=150e3))
    assert not before.differs(changed(before, least_ohm=50e3, most_ohm=100e3))
    assert before.differs(changed(before, least_ohm=111e3, most_ohm=150e3))
    assert before.differs(changed(before, least_ohm=50e3, most_ohm=99e3))
    # Skin resists half as much at 8 mA as at none.
    assert not before.differs(exact(51e3, current_ua=8_000.0))
    assert before.differs(exact(49e3, current_ua=8_000.0))
    assert not exact(50e3, current_ua=8_000.0).differs(exact(99e3, current_ua=1.0))
    assert exact(50e3, current_ua=8_000.0).differs(exact(101e3, current_ua=1.0))
