"""`present(on_trigger=True)` from the client's request to the wires and back, on stepped time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from etd import Refused
from etd.client.course import Course, Ended, Pause, holding
from etd.client.options import frame_fields
from etd.client.presented import Presented
from etd.client.session import Session
from stepped_daemon import SteppedDaemon, SteppedDisplay
from trace_decoder import Phase

pytestmark = pytest.mark.slow

N = 8
MS = 1_000_000
WANTED = [0, 900, 0, 0, 0, 900, 0, 0]


@pytest.fixture
def daemon() -> Iterator[SteppedDaemon]:
    with SteppedDaemon("pad-8", is_traced=True) as made:
        yield made


@pytest.fixture
def display(daemon: SteppedDaemon) -> SteppedDisplay:
    made = SteppedDisplay(daemon, 3_000, 100)
    made.arm()
    for _ in range(20):
        if made.present([900] * N, 0.1, 60.0).as_asked:
            break
    return made


def flowed(daemon: SteppedDaemon, since_ns: int) -> list[Phase]:
    """What was fired of a frame; contact polls are weaker."""
    return [
        phase
        for phase in daemon.followed.phases()
        if phase.from_ns >= since_ns and phase.current_ua > 400
    ]


def meanwhile(
    course: Course[Presented], daemon: SteppedDaemon, doing: Callable[[int], object]
) -> Course[Presented]:
    """Before each pause of the course, with its number; what is raised is what ends the pause."""
    step, number = next(course), 0
    try:
        while True:
            try:
                if isinstance(step, Pause):
                    number += 1
                    doing(number)
                done = yield step
            except (Refused, Ended) as error:
                step = course.throw(error)
            else:
                step = course.send(done)
    except StopIteration as end:
        presented: Presented = end.value
        return presented


@pytest.mark.parametrize("seconds", [0.02, 0.3, 1.5])
@pytest.mark.parametrize("edge_ms", [1, 700, 2_900])
def test_it_is_shown_for_so_long_from_the_edge_on(
    daemon: SteppedDaemon, display: SteppedDisplay, seconds: float, edge_ms: int
) -> None:
    since_ns = daemon.now_ns()
    edge_ns = since_ns + 200 * MS + edge_ms * MS
    daemon.fake.world.trigger(edge_ns)
    presented = display.present(WANTED, seconds, 50.0, on_trigger=True)
    fired = flowed(daemon, since_ns)
    assert presented.as_asked, presented.why_not
    assert presented.trigger_ns == edge_ns
    assert presented.latency_ns is not None
    assert 0 < presented.latency_ns < MS
    assert presented.first_ns == pytest.approx(fired[0].from_ns, abs=100_000)
    assert 0 < fired[0].from_ns - edge_ns < MS
    over_ns = edge_ns + int(seconds * 1e9)
    assert over_ns - 25 * MS < fired[-1].from_ns < over_ns + MS
    assert sum(presented.pulses) == len(fired)
    assert {phase.electrode for phase in fired} == {1, 5}


def test_so_many_pulses_are_fired_once_however_long_it_waits(
    daemon: SteppedDaemon, display: SteppedDisplay
) -> None:
    since_ns = daemon.now_ns()
    for late_ms in (2_345, 2_800):
        daemon.fake.world.trigger(since_ns + late_ms * MS)
    presented = display.present(WANTED, 0.2, 50.0, on_trigger=True, pulses=3)
    assert presented.pulses == (0, 3, 0, 0, 0, 3, 0, 0)
    assert len(flowed(daemon, since_ns)) == 6
    assert presented.as_asked, presented.why_not


def test_without_an_edge_nothing_is_fired_and_that_is_said(
    daemon: SteppedDaemon, display: SteppedDisplay
) -> None:
    since_ns = daemon.now_ns()
    course = display.presenting(WANTED, 0.2, 50.0, wait_s=1.2, on_trigger=True)
    with pytest.raises(Refused, match="no edge of the trigger came while it waited") as refused:
        display.play(course)
    assert refused.value.code == "expired"
    assert 1.2 <= (daemon.now_ns() - since_ns) / 1e9 < 1.6
    daemon.fake.world.trigger()
    daemon.sleep_until_ns(daemon.now_ns() + 100 * MS)
    assert flowed(daemon, since_ns) == []


def test_one_that_is_ended_while_it_waits_fires_nothing(
    daemon: SteppedDaemon, display: SteppedDisplay
) -> None:
    since_ns = daemon.now_ns()

    def end(number: int) -> None:
        if number == 4:
            raise Ended

    course = display.presenting(WANTED, 0.2, 50.0, on_trigger=True)
    with pytest.raises(Refused, match="it was ended before its first scan began"):
        display.play(meanwhile(course, daemon, end))
    daemon.fake.world.trigger()
    daemon.sleep_until_ns(daemon.now_ns() + 100 * MS)
    assert flowed(daemon, since_ns) == []


def test_one_whose_edge_came_with_its_end_says_what_was_fired(
    daemon: SteppedDaemon, display: SteppedDisplay
) -> None:
    """The edge is not known here yet, when it is ended."""
    since_ns = daemon.now_ns()

    def end(number: int) -> None:
        if number == 4:
            daemon.fake.world.trigger()
            daemon.sleep_until_ns(daemon.now_ns() + 30 * MS)
            raise Ended

    course = display.presenting(WANTED, 0.2, 50.0, on_trigger=True)
    presented = display.play(meanwhile(course, daemon, end))
    assert presented.trigger_ns is not None
    assert sum(presented.pulses) == len(flowed(daemon, since_ns)) > 0
    assert any("it was ended" in why for why in presented.why_not)


def test_a_stop_ends_the_wait(daemon: SteppedDaemon, display: SteppedDisplay) -> None:
    def stop(number: int) -> None:
        if number == 4:
            display.stop()

    course = display.presenting(WANTED, 0.2, 50.0, on_trigger=True)
    with pytest.raises(Refused) as refused:
        display.play(meanwhile(course, daemon, stop))
    assert refused.value.code == "halted"


@pytest.mark.parametrize(
    ("options", "seconds", "wait_s", "why"),
    [
        ({}, 0.2, 31.0, "wait_s=31.0: at most 30 s"),
        ({}, 0.2, 0.0, "wait_s=0.0: a number of seconds above 0"),
        ({"pulses": 3}, 0.9, 1.0, "give at most 0.6 s"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(
    display: SteppedDisplay, options: dict[str, Any], seconds: float, wait_s: float, why: str
) -> None:
    course = display.presenting(WANTED, seconds, 50.0, wait_s=wait_s, on_trigger=True, **options)
    with pytest.raises(Refused, match=why):
        next(course)


def test_hold_does_not_wait() -> None:
    fields = frame_fields("level", [1, 0], {"on_trigger": True})
    with pytest.raises(Refused, match="use present"):
        next(holding(Session("me"), fields, 1.0, lambda: 0))
