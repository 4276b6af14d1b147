"""Contact as a law: what an open, new, shrinking, overstrained or shorted contact gets."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.protocol.messages import ContactState
from etd.pulse.request import PulseRequest
from etd.stabilize.contact import Contact
from etd.stabilize.law_settings import ContactSettings
from etd.stabilize.pipeline import ElectrodeEstimate
from plain_records import changed

MS = 1_000_000
FRAME = PulseRequest(3_000, 100)
CLOSED = ElectrodeEstimate(3, state="closed")
STATES: tuple[ContactState, ...] = ("unknown", "open", "soft", "closed", "saturated", "shorted")


def contact(**law: float) -> Contact:
    return Contact(ContactSettings(**law), leak_ohm=66_000.0, compliance_v=300.0, is_alone=True)


def test_a_firm_contact_gets_what_is_wanted() -> None:
    assert contact().adapt(FRAME, CLOSED) == FRAME


@pytest.mark.parametrize(
    ("firmness", "current_ua"), [(0.0, 500), (0.5, 1_750), (0.99, 2_975), (1.0, 3_000)]
)
def test_a_new_contact_begins_at_half_of_its_threshold(firmness: float, current_ua: int) -> None:
    soft = changed(CLOSED, state="soft", firmness=firmness, threshold_ua=1_000)
    assert contact().adapt(FRAME, soft) == PulseRequest(current_ua, 100)


def test_without_a_threshold_it_begins_at_half_of_what_is_wanted() -> None:
    soft = changed(CLOSED, state="soft", firmness=0.0)
    assert contact().adapt(FRAME, soft) == PulseRequest(1_500, 100)


@pytest.mark.parametrize("state", ["open", "shorted"])
def test_an_open_or_shorted_one_gets_the_beginning_only(state: ContactState) -> None:
    assert contact().adapt(FRAME, changed(CLOSED, state=state, threshold_ua=800)).current_ua == 400


def test_peeling_drops_at_once() -> None:
    law = contact()
    assert law.adapt(FRAME, CLOSED) == FRAME
    peeled = changed(CLOSED, state="soft", firmness=0.0, now_ns=16 * MS)
    assert law.adapt(FRAME, peeled).current_ua == 1_500


def test_what_could_not_be_delivered_is_asked_for_less_and_comes_back_slowly() -> None:
    law = contact(back_off=0.8, rise_per_s=0.2)
    saturated = changed(CLOSED, state="saturated", undelivered_ua=3_000, now_ns=0)
    assert law.adapt(FRAME, saturated).current_ua == 2_400
    for step in range(1, 6):
        asked = law.adapt(FRAME, changed(CLOSED, now_ns=step * 100 * MS))
    assert 2_400 < asked.current_ua <= 2_400 + 300


def test_however_long_it_saturates_nothing_winds_up() -> None:
    law = contact()
    saturated = changed(CLOSED, state="saturated", undelivered_ua=3_000)
    for step in range(1_000):
        law.adapt(FRAME, changed(saturated, now_ns=step * 16 * MS))
    after = law.adapt(FRAME, changed(CLOSED, now_ns=16_016 * MS))
    assert after.current_ua <= 2_400 + 100


def test_what_the_resistance_says_cannot_be_delivered_is_not_asked_for() -> None:
    # 300 V through 200 k beside 66 k: 6 mA less a tenth.
    tight = changed(CLOSED, skin_ohm=200_000.0)
    most_ua = 0.9 * 300.0 * (1 / 200_000 + 1 / 66_000) * 1e6
    assert contact().adapt(PulseRequest(8_000, 100), tight).current_ua == pytest.approx(
        most_ua, abs=1
    )
    assert contact().adapt(FRAME, tight) == FRAME


@given(
    states=st.lists(
        st.tuples(
            st.sampled_from(STATES),
            st.floats(0.0, 1.0),
            st.one_of(st.none(), st.integers(1, 10_000)),
            st.one_of(st.none(), st.floats(1e3, 2e6)),
            st.integers(0, 10_000),
        ),
        min_size=1,
        max_size=30,
    ),
    threshold_ua=st.one_of(st.none(), st.integers(0, 10_000)),
)
def test_it_never_asks_for_more_than_was_wanted(
    states: list[tuple[ContactState, float, int | None, float | None, int]],
    threshold_ua: int | None,
) -> None:
    law = contact()
    for step, (state, firmness, undelivered_ua, skin_ohm, wanted_ua) in enumerate(states):
        seen = ElectrodeEstimate(
            3,
            now_ns=step * 16 * MS,
            state=state,
            firmness=firmness,
            undelivered_ua=undelivered_ua,
            skin_ohm=skin_ohm,
            threshold_ua=threshold_ua,
        )
        asked = law.adapt(PulseRequest(wanted_ua, 100), seen)
        assert 0 <= asked.current_ua <= wanted_ua
        assert asked.width_us == 100
