"""Presenting, from the client's request to the wires and back, on stepped time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from etd.client.course import Course, Pause
from etd.client.presented import Presented
from etd.protocol.errors import Refused
from stepped_daemon import SteppedDaemon, SteppedDisplay
from trace_decoder import Phase

N = 8
CAP_UA, WIDTH_US = 3_000, 100
STEP_UA = 10_000 / 4_095
SECOND_NS = 1_000_000_000


@pytest.fixture
def daemon() -> Iterator[SteppedDaemon]:
    with SteppedDaemon("pad-8", is_traced=True) as made:
        yield made


def armed(daemon: SteppedDaemon) -> SteppedDisplay:
    display = SteppedDisplay(daemon, CAP_UA, WIDTH_US)
    display.arm()
    return display


def opened(daemon: SteppedDaemon, current_ua: int = 2_500) -> SteppedDisplay:
    """After a told opening: presented until nothing is cut any more."""
    display = armed(daemon)
    for _ in range(20):
        if display.present([current_ua] * N, 0.3, 60.0).as_asked:
            return display
    raise AssertionError("it does not open")


def rest(daemon: SteppedDaemon, display: SteppedDisplay, seconds: float) -> None:
    """A pause, through which the lease is kept."""
    end_ns = daemon.now_ns() + int(seconds * SECOND_NS)
    while daemon.now_ns() < end_ns:
        display.keep()
        daemon.sleep_until_ns(min(end_ns, daemon.now_ns() + SECOND_NS // 2))
    display.keep()


def stopped_in_a_pause(course: Course[Presented], display: SteppedDisplay) -> Course[Presented]:
    step = next(course)
    while True:
        if isinstance(step, Pause):
            display.stop()
        try:
            done = yield step
        except Refused as refusal:
            step = course.throw(refusal)
        else:
            step = course.send(done)


def flowed(daemon: SteppedDaemon, presented: Presented) -> list[Phase]:
    """Pulses of its frames; those at electrodes that they leave silent are looks."""
    return [
        phase
        for phase in daemon.followed.phases()
        if phase.seq in presented.seqs and presented.wanted_ua[phase.electrode or 0]
    ]


def check(presented: Presented, fired: Sequence[Phase], wanted_ua: Sequence[int]) -> None:
    assert presented.wanted_ua == tuple(wanted_ua)
    begun_ns = [phase.from_ns for phase in fired]
    assert (presented.first_ns is None) == (not begun_ns)
    if presented.first_ns is not None and presented.last_ns is not None:
        assert abs(min(begun_ns) - presented.first_ns) < 100_000
        assert abs(max(begun_ns) - presented.last_ns) < 100_000
    for electrode in range(N):
        mine_ua = [phase.current_ua for phase in fired if phase.electrode == electrode]
        assert presented.pulses[electrode] == len(mine_ua)
        assert presented.least_ua[electrode] == pytest.approx(min(mine_ua, default=0), abs=1)
        if presented.as_asked and wanted_ua[electrode]:
            assert all(
                wanted_ua[electrode] - STEP_UA <= ua <= wanted_ua[electrode] for ua in mine_ua
            )


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
    """More of them than the engine keeps accounts of."""
    display = opened(daemon)
    wanted_ua = [0, 0, 0, 2_000, 0, 0, 0, 0]
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
    course = display.presenting([0, 0, 0, 2_000, 0, 0, 0, 0], 0.2, 50.0)
    with pytest.raises(Refused, match="asked to stop") as caught:
        display.play(stopped_in_a_pause(course, display))
    assert caught.value.code == "halted"


trials = st.tuples(
    st.sampled_from([0.02, 0.4, 1.5, 20.0, 61.0]),
    st.lists(st.sampled_from([0, 0, 0, 300, 1_000, 2_400]), min_size=N, max_size=N),
    st.sampled_from([0.05, 0.2, 0.7, 1.3]),
    st.sampled_from([20.0, 60.0]),
)


@settings(
    deadline=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
@given(script=st.lists(trials, min_size=1, max_size=5))
def test_what_any_script_is_told_is_what_flowed(
    script: list[tuple[float, list[int], float, float]],
) -> None:
    with SteppedDaemon("pad-8", is_traced=True) as daemon:
        display = armed(daemon)
        for pause_s, wanted_ua, seconds, rate_hz in script:
            rest(daemon, display, pause_s)
            presented = display.present(wanted_ua, seconds, rate_hz)
            check(presented, flowed(daemon, presented), wanted_ua)
