"""What a presentation says that a lapse of the lease, or another one, has cut short."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest

from etd.client.course import Ended
from etd.client.presented import CutShort, Presented
from etd.protocol.errors import Refused
from presenting_scenes import SECOND_NS, check, flowed, meanwhile, opened
from stepped_daemon import SteppedDaemon, SteppedDisplay

WANTED_UA = [0, 0, 0, 2_000, 0, 0, 0, 0]
STRONG_UA = [0, 0, 0, 2_400, 0, 0, 0, 0]
OTHER_UA = [0, 0, 0, 0, 0, 1_500, 0, 0]


@pytest.fixture
def daemon() -> Iterator[SteppedDaemon]:
    with SteppedDaemon("pad-8", is_traced=True) as made:
        yield made


def hung(daemon: SteppedDaemon, display: SteppedDisplay, keeps: bool) -> Callable[[], None]:
    """The program stands still for two seconds; with `keeps` its keeper is the first to go on."""

    def happen() -> None:
        daemon.sleep_until_ns(daemon.now_ns() + 2 * SECOND_NS)
        if keeps:
            with contextlib.suppress(Refused):
                display.keep()

    return happen


# --- a lapse of the lease -------------------------------------------------------------------------


@pytest.mark.parametrize("keeps", [False, True])
@pytest.mark.parametrize(("seconds", "pause"), [(0.2, 1), (0.5, 1), (3.0, 4)])
def test_a_program_that_stood_still_is_told_what_was_fired_until_then(
    daemon: SteppedDaemon, *, keeps: bool, seconds: float, pause: int
) -> None:
    """Whoever notices first that the lease has lapsed: the keeper, or the presentation."""
    display = opened(daemon)
    course = display.presenting(WANTED_UA, seconds, 50.0)
    with pytest.raises(CutShort) as caught:
        display.play(meanwhile(course, pause, hung(daemon, display, keeps)))
    assert caught.value.code == "no_lease"
    presented = caught.value.presented
    check(presented, flowed(daemon, presented), WANTED_UA)
    assert presented.pulses[3] > 0
    # No lease was opened beside the program's back.
    with pytest.raises(Refused, match=r"call arm\(\) first"):
        display.keep()


@pytest.mark.parametrize("keeps", [False, True])
def test_one_that_is_ended_after_a_lapse_opens_no_lease(
    daemon: SteppedDaemon, *, keeps: bool
) -> None:
    display = opened(daemon)

    def happen() -> None:
        hung(daemon, display, keeps)()
        raise Ended

    presented = display.play(meanwhile(display.presenting(WANTED_UA, 0.5, 50.0), 1, happen))
    assert any("it was ended after" in why for why in presented.why_not)
    check(presented, flowed(daemon, presented), WANTED_UA)
    with pytest.raises(Refused) as later:
        display.keep()
    assert later.value.code == "no_lease"


def test_one_whose_accounts_went_with_another_lease_is_refused(daemon: SteppedDaemon) -> None:
    """The program has armed anew meanwhile: its own frames are another lease's."""
    display = opened(daemon)

    def happen() -> None:
        hung(daemon, display, keeps=True)()
        display.arm()

    with pytest.raises(Refused, match="the lease that it was shown under has ended") as caught:
        display.play(meanwhile(display.presenting(WANTED_UA, 0.5, 50.0), 1, happen))
    assert caught.value.code == "no_lease"
    assert not isinstance(caught.value, CutShort)
    display.keep()


# --- another frame of the program -----------------------------------------------------------------


def begun_ua(
    display: SteppedDisplay, wanted_ua: list[int], seconds: float
) -> Callable[[], Presented]:
    """Another one of the program, as `begin` makes it, played to its end."""
    return lambda: display.play(
        display.presenting(wanted_ua, seconds, 50.0, after=display.last_seq)
    )


@pytest.mark.parametrize(("pause", "pulses"), [(2, 17), (3, 34)])
def test_one_that_another_replaces_is_told_when_that_was(
    daemon: SteppedDaemon, pause: int, pulses: int
) -> None:
    """It notices only when it would renew its frame, long after its end."""
    display, others = opened(daemon), []

    def happen() -> None:
        others.append(begun_ua(display, OTHER_UA, 0.9)())

    presented = display.play(meanwhile(display.presenting(WANTED_UA, 1.5, 50.0), pause, happen))
    check(presented, flowed(daemon, presented), WANTED_UA)
    assert presented.pulses[3] == pytest.approx(pulses, abs=1)
    (why,) = presented.why_not
    told_s = float(why.removeprefix("another frame of the program replaced it after ").split()[0])
    assert told_s == pytest.approx(pulses / 50, abs=0.03)
    (other,) = others
    assert other.as_asked, other.why_not
    check(other, flowed(daemon, other), OTHER_UA)


def test_the_end_of_one_that_was_replaced_leaves_the_other_alone(daemon: SteppedDaemon) -> None:
    display = opened(daemon)

    def happen() -> None:
        display.show_current(OTHER_UA, ttl_ms=400, rate_hz=50.0)
        raise Ended

    presented = display.play(meanwhile(display.presenting(WANTED_UA, 1.5, 50.0), 2, happen))
    (why,) = presented.why_not
    assert why.startswith("another frame of the program replaced it after 0.3")
    before = len(daemon.followed.phases())
    display.keep()
    daemon.sleep_until_ns(daemon.now_ns() + SECOND_NS // 2)
    later = daemon.followed.phases()[before:]
    assert sum(phase.electrode == 5 for phase in later) >= 18, "it is shown for its ttl"


def test_one_that_is_ended_is_told_by_the_end_of_its_frame(daemon: SteppedDaemon) -> None:
    display = opened(daemon)

    def happen() -> None:
        raise Ended

    presented = display.play(meanwhile(display.presenting(WANTED_UA, 1.5, 50.0), 2, happen))
    (why,) = presented.why_not
    assert why.startswith("it was ended after 0.3")
    check(presented, flowed(daemon, presented), WANTED_UA)


# --- its net charge -------------------------------------------------------------------------------


def test_what_is_refused_while_it_is_shown_is_dark_from_then_on(daemon: SteppedDaemon) -> None:
    """And not until its ttl: what is said of it is all that was fired."""
    display = opened(daemon)
    with pytest.raises(CutShort, match="net charge") as caught:
        display.play(display.presenting(STRONG_UA, 3.0, 60.0))
    presented = caught.value.presented
    assert caught.value.code == "over_maximum"
    phases = flowed(daemon, presented)
    check(presented, phases, STRONG_UA)
    told_s = float(presented.why_not[-1].split("after ")[1].split(" s")[0])
    assert (phases[-1].from_ns - phases[0].from_ns) / SECOND_NS == pytest.approx(told_s, abs=0.05)
    assert daemon.now_ns() - phases[-1].from_ns < SECOND_NS // 10
