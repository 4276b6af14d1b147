"""Presenting, from the client's request to the wires and back, on stepped time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from etd.client.presented import CutShort
from etd.protocol.errors import Refused
from presenting_scenes import SECOND_NS, N, armed, check, flowed, meanwhile, opened, rest
from stepped_daemon import SteppedDaemon


@pytest.fixture
def daemon() -> Iterator[SteppedDaemon]:
    with SteppedDaemon("pad-8", is_traced=True) as made:
        yield made


def test_the_natural_loop_of_twenty_trials_fires_what_was_asked(daemon: SteppedDaemon) -> None:
    display = opened(daemon)
    for trial in range(20):
        rest(daemon, display, 1.5)
        wanted_ua = [0] * N
        wanted_ua[trial % N] = 500 + 100 * trial
        presented = display.present(wanted_ua, 0.2, 50.0)
        assert presented.as_asked, presented.why_not
        check(presented, flowed(daemon, presented), wanted_ua)
        assert presented.pulses[trial % N] == 10


def test_the_first_presentation_says_that_the_soft_start_took_from_it(
    daemon: SteppedDaemon,
) -> None:
    presented = armed(daemon).present([0, 0, 0, 2_000, 0, 0, 0, 0], 0.2, 50.0)
    assert not presented.as_asked
    (why,) = presented.why_not
    assert why.startswith("electrode 3: ")
    assert "of 2000 uA (soft_start" in why


def test_a_presentation_that_is_longer_than_a_frame_is_renewed_and_told_as_one(
    daemon: SteppedDaemon,
) -> None:
    display = opened(daemon)
    wanted_ua = [0, 0, 0, 2_000, 0, 0, 0, 0]
    presented = display.present(wanted_ua, 2.5, 50.0)
    assert presented.as_asked, presented.why_not
    check(presented, flowed(daemon, presented), wanted_ua)
    assert presented.pulses[3] == 125
    assert presented.last_ns is not None
    assert presented.first_ns is not None
    assert presented.last_ns - presented.first_ns == pytest.approx(2.48 * SECOND_NS, abs=1e6)
    assert 0 < presented.delivered_ua[3] <= 2_000


def test_a_long_one_of_many_frames_is_told_whole(daemon: SteppedDaemon) -> None:
    """More of them than the engine keeps accounts of, at a current that net charge lets stand."""
    display = opened(daemon)
    wanted_ua = [0, 0, 0, 1_500, 0, 0, 0, 0]
    presented = display.present(wanted_ua, 10.0, 50.0, ttl_ms=90)
    assert presented.as_asked, presented.why_not
    assert len(presented.seqs) > 256
    assert presented.pulses[3] == 500
    check(presented, flowed(daemon, presented), wanted_ua)


def test_a_slow_rate_needs_no_frame_to_begin_in_each_ttl(daemon: SteppedDaemon) -> None:
    display = opened(daemon)
    presented = display.present([0, 0, 0, 2_000, 0, 0, 0, 0], 3.0, 0.5)
    assert presented.as_asked, presented.why_not
    assert presented.pulses[3] == 2


def test_it_waits_until_it_is_known_what_the_returns_carry(daemon: SteppedDaemon) -> None:
    """Held a single electrode, the others' shares are forgotten: they are looked at first."""
    display = opened(daemon)
    for _ in range(3):
        rest(daemon, display, 20.0)
        presented = display.present([0, 0, 0, 2_500, 0, 0, 0, 0], 0.2, 50.0)
        assert presented.as_asked, presented.why_not


def test_what_ends_it_early_is_told(daemon: SteppedDaemon) -> None:
    display = opened(daemon)
    wanted_ua = [0, 0, 0, 2_000, 0, 0, 0, 0]
    course = display.presenting(wanted_ua, 1.0, 50.0, ttl_ms=300)
    with pytest.raises(CutShort, match="asked to stop") as caught:
        display.play(meanwhile(course, 4, display.stop))
    assert caught.value.code == "halted"
    presented = caught.value.presented
    check(presented, flowed(daemon, presented), wanted_ua)
    assert 14 <= presented.pulses[3] <= 16, "three tenths of a second"
    assert presented.why_not[0].startswith("it was cut short after 0.")


def test_a_lapsed_lease_cuts_short_as_a_halt_does(daemon: SteppedDaemon) -> None:
    display = opened(daemon)
    wanted_ua = [0, 0, 0, 2_000, 0, 0, 0, 0]
    course = display.presenting(wanted_ua, 0.2, 50.0)
    with pytest.raises(CutShort) as caught:
        display.play(
            meanwhile(course, 1, lambda: daemon.sleep_until_ns(daemon.now_ns() + 2 * SECOND_NS))
        )
    assert caught.value.code == "no_lease"
    assert caught.value.presented.pulses[3] == 10


def test_what_is_refused_before_anything_was_fired_is_not_cut_short(daemon: SteppedDaemon) -> None:
    display = opened(daemon)
    display.disarm()
    with pytest.raises(Refused) as caught:
        display.present([0, 0, 0, 2_000, 0, 0, 0, 0], 0.2, 50.0)
    assert caught.value.code == "not_armed"
    assert not isinstance(caught.value, CutShort)
