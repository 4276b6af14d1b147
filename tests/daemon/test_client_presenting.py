"""`present`, `begin`, `kept`, and levels by place, as an application calls them."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from etd import AsyncDisplay, CutShort, Display, Refused
from etd.client import clock
from etd.client.course import Pause, holding
from etd.client.presenting import presenting
from etd.client.session import Session
from etd.protocol.link import Answer, AskAccount, Command, KeepLease, NewFrame
from etd.protocol.outcome import Clamp, Shortfall
from gateway_rig import ServedRig
from scripted_engine import account, full_answer

pytestmark = pytest.mark.slow

FIRST = [2_000, 0, 0, 0]


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


def display(rig: ServedRig) -> Display:
    made = Display(address=rig.address, max_current_ua=3000, width_us=100, client="me")
    made.arm()
    return made


def frames_of(rig: ServedRig) -> list[Any]:
    """Those that are shown."""
    return [sent.frame for sent in rig.engine.frames if not sent.frame.preview]


def answering(**changes: Any) -> Callable[[Command | NewFrame], Answer]:
    """Accounts have these changes."""

    def answer(message: Command | NewFrame) -> Answer:
        if isinstance(message, AskAccount):
            return Answer(ref=message.ref, account=account(message.seq, **changes))
        return full_answer(message)

    return answer


# --- present --------------------------------------------------------------------------------------


def test_present_shows_for_so_long_falls_silent_and_says_what_was_fired(rig: ServedRig) -> None:
    with display(rig) as d:
        presented = d.present_current(FIRST, seconds=0.1)
    shown, silence = frames_of(rig)
    assert (shown.current_ua, shown.ttl_ms, shown.account) == ((2_000, 0, 0, 0), 100, True)
    assert silence.current_ua == (0, 0, 0, 0)
    assert presented.as_asked
    assert str(presented) == "6 pulses at electrode 0, 1998 uA, 60.0 Hz: as asked"
    assert presented.pulses == (6, 0, 0, 0)
    assert presented.least_ua == (1_998, 0, 0, 0)
    assert presented.delivered_ua == (1_900, 0, 0, 0)
    assert presented.first_at is not None
    assert presented.first_at.utcoffset() is not None
    since = presented.first_at.timestamp() * 1e9 - presented.wall_offset_ns
    assert since == pytest.approx(presented.first_ns, abs=2_000)


def test_a_longer_one_is_renewed_and_its_accounts_are_one(rig: ServedRig) -> None:
    with display(rig) as d:
        presented = d.present([1, 0, 0, 0], seconds=0.5, ttl_ms=300)
    *shown, silence = frames_of(rig)
    assert len(shown) == 3
    assert all(frame.ttl_ms == 300 for frame in shown)
    assert silence.level == (0, 0, 0, 0)
    assert presented.pulses == (18, 0, 0, 0)
    assert presented.first_ns == 1_000 * shown[0].seq
    assert presented.last_ns == 1_000 * shown[-1].seq + 500
    assert presented.delivered_ua == (1_900, 0, 0, 0)


def soft_start(allowed_ua: int) -> Clamp:
    return Clamp(
        electrode=0, wanted_ua=2_000, allowed_ua=allowed_ua, reason="soft_start", limited_by=0
    )


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"clamped": (soft_start(500),)}, "electrode 0: 500 of 2000 uA (soft_start of electrode"),
        ({"not_fired": (Shortfall(electrode=0, reason="ledger", pulses=3),)}, "3 pulses were not"),
        (
            {"not_fired": (Shortfall(electrode=None, reason="rate", rate_hz=20.0),)},
            "slowed to 20.0 Hz (rate)",
        ),
        (
            {"not_fired": (Shortfall(electrode=0, reason="balanced"),)},
            "electrode 0: all pulses had both phases",
        ),
        ({"pulses": (0, 0, 0, 0), "first_ns": None}, "electrode 0: no pulse was fired"),
        ({"ended": "silenced"}, "it was silenced"),
    ],
)
def test_what_was_not_as_asked_is_said_in_a_sentence(
    rig: ServedRig, changes: dict[str, Any], why: str
) -> None:
    rig.engine.answer = answering(**changes)
    with display(rig) as d:
        presented = d.present_current(FIRST, seconds=0.05)
    assert not presented.as_asked
    assert len(presented.why_not) == 1
    assert why in presented.why_not[0]


def test_a_frame_that_expired_before_it_was_renewed_is_told(rig: ServedRig) -> None:
    rig.engine.answer = answering(ended="expired")
    with display(rig) as d:
        presented = d.present_current(FIRST, seconds=0.15, ttl_ms=100)
    assert presented.why_not == ("it was renewed too late: give it a longer ttl_ms",)


def test_a_scan_that_was_late_takes_nothing(rig: ServedRig) -> None:
    late = Shortfall(electrode=None, reason="overrun", pulses=2)
    rig.engine.answer = answering(not_fired=(late,))
    with display(rig) as d:
        presented = d.present_current(FIRST, seconds=0.05)
    assert presented.as_asked
    assert presented.not_fired == (late,)


@pytest.mark.parametrize(("allowed_ua", "silences"), [((900, None), 1), ((900, 900), 1)])
def test_what_the_returns_carry_is_looked_at_first(
    rig: ServedRig, allowed_ua: tuple[int | None, ...], silences: int
) -> None:
    """In a silent frame; where that tells nothing new, it is shown as far as its limits go."""
    left = list(allowed_ua)

    def answer(message: Command | NewFrame) -> Answer:
        if not isinstance(message, NewFrame) or not message.frame.preview:
            return full_answer(message)
        allowed = left.pop(0)
        if allowed is None:
            return full_answer(message)
        weak = Clamp(
            electrode=0, wanted_ua=2_000, allowed_ua=allowed, reason="return_cap", limited_by=2
        )
        return Answer(ref=message.ref, rate_hz=60.0, clamped=(weak,))

    rig.engine.answer = answer
    with display(rig) as d:
        d.present_current(FIRST, seconds=0.05, strict=True)
    assert left == []
    assert not any(sent.frame.strict for sent in rig.engine.frames if sent.frame.preview)
    *looks, shown, _ = frames_of(rig)
    assert [frame.current_ua for frame in looks] == [(0, 0, 0, 0)] * silences
    assert shown.current_ua == (2_000, 0, 0, 0)


def test_a_preview_shows_nothing(rig: ServedRig) -> None:
    with display(rig) as d:
        assert d.preview([1, 0, 0, 0]).rate_hz == 60.0
    assert frames_of(rig) == []
    assert len(rig.engine.frames) == 1


def test_so_many_pulses_are_one_frame_and_are_counted(rig: ServedRig) -> None:
    with display(rig) as d:
        assert d.present_current(FIRST, seconds=0.1, pulses=6, ttl_ms=20).as_asked
        shown, _ = frames_of(rig)
        assert (shown.pulses, shown.ttl_ms) == (6, 100)
        presented = d.present_current(FIRST, seconds=0.1, pulses=50)
        assert presented.why_not == ("electrode 0: 6 of 50 pulses",)
        with pytest.raises(Refused, match="for a second at most"):
            d.present_current(FIRST, seconds=1.5, pulses=6)


def test_fewer_pulses_than_rate_and_time_make_are_told(rig: ServedRig) -> None:
    with display(rig) as d:
        (why,) = d.present_current(FIRST, seconds=0.4).why_not
    assert why.startswith("6 of about 24 pulses")


def test_the_lag_of_a_fakes_clock_is_in_what_is_said_of_times(rig: ServedRig) -> None:
    rig.engine.answer = answering(clock_lag_us=500_000)
    with display(rig) as d:
        presented = d.present_current(FIRST, seconds=0.05)
    assert presented.uncertainty_ns == 500_000_000
    assert abs(presented.wall_offset_ns - clock.wall_offset_ns() - 500_000_000) < 50_000_000


def test_a_renewal_that_came_too_late_is_told_and_the_next_one_sent(rig: ServedRig) -> None:
    late = [False, True, False]

    def answer(message: Command | NewFrame) -> Answer:
        is_shown = isinstance(message, NewFrame) and message.frame.account
        if is_shown and late and late.pop(0):
            return Answer(ref=message.ref, error="expired", reason="sent 300 ms ago")
        return full_answer(message)

    rig.engine.answer = answer
    with display(rig) as d:
        presented = d.present_current(FIRST, seconds=0.3, ttl_ms=150)
    assert late == []
    assert "it was renewed too late: give it a longer ttl_ms" in presented.why_not


@pytest.mark.parametrize("options", [{"ttl_ms": np.int64(300)}, {"ttl_ms": None}])
def test_options_of_any_kind_are_read_once(rig: ServedRig, options: dict[str, Any]) -> None:
    with display(rig) as d:
        d.present_current(FIRST, seconds=0.02, **options)
        d.hold_current(FIRST, seconds=0.02, **options)


@pytest.mark.parametrize("what", [RuntimeError, SystemExit, KeyboardInterrupt])
def test_whatever_ends_a_program_ends_it_silent(what: type[BaseException]) -> None:
    session = Session("me", max_current_ua=3_000, width_us=100)
    session.lease = "a"
    for course in (
        holding(session, {"current_ua": FIRST}, 1.0, clock.now_ns),
        presenting(session, {"current_ua": FIRST}, 1.0, clock.now_ns),
    ):
        next(course)
        step = course.throw(what("gone"))
        assert not isinstance(step, Pause)
        assert b'"current_ua":[0,0,0,0]' in next(step).data
        with pytest.raises(what):
            course.send(None)


def test_a_refusal_of_an_old_lease_leaves_the_new_one(rig: ServedRig) -> None:
    session = Session("me", max_current_ua=3_000, width_us=100)
    session.lease = "old"
    ask = next(session.keep())
    session.lease = "new"
    refusal = b'{"ok":false,"error":"no_lease","reason":"","now_ns":1,"id":1}'
    with pytest.raises(Refused):
        session.settle(ask, refusal)
    assert session.lease == "new"


def halting_after(frames: int) -> Callable[[Command | NewFrame], Answer]:
    """So many frames are shown, and are then accounted for."""
    shown = 0

    def answer(message: Command | NewFrame) -> Answer:
        nonlocal shown
        if isinstance(message, NewFrame) and not message.frame.preview:
            shown += 1
            if shown > frames:
                return Answer(ref=message.ref, error="halted", reason="the wearer stopped it")
        return full_answer(message)

    return answer


def test_what_a_halt_cuts_short_says_what_was_fired(rig: ServedRig) -> None:
    with display(rig) as d:
        rig.engine.answer = halting_after(2)
        with pytest.raises(CutShort, match=r"the wearer stopped it.*after 12 pulses") as caught:
            d.present_current(FIRST, seconds=0.5, ttl_ms=150)
        assert caught.value.code == "halted"
        assert caught.value.presented.pulses == (12, 0, 0, 0)
        with pytest.raises(Refused, match=r"the wearer stopped it.*call arm\(\) first") as later:
            d.mark("trial 2")
        assert later.value.code == "halted"
        d.clear()
        with pytest.raises(Refused, match=r"call arm\(\) first") as cleared:
            d.keep()
        assert cleared.value.code == "no_lease"


def test_what_is_refused_before_its_first_pulse_is_a_refusal(rig: ServedRig) -> None:
    with display(rig) as d:
        rig.engine.answer = halting_after(0)
        with pytest.raises(Refused, match="the wearer stopped it") as caught:
            d.present_current(FIRST, seconds=0.5)
    assert not isinstance(caught.value, CutShort)


def test_a_halt_of_which_no_account_is_left_is_a_refusal(rig: ServedRig) -> None:
    halting = halting_after(2)

    def answer(message: Command | NewFrame) -> Answer:
        if isinstance(message, AskAccount):
            return Answer(ref=message.ref, error="no_lease", reason="another lease was opened")
        return halting(message)

    with display(rig) as d:
        rig.engine.answer = answer
        with pytest.raises(Refused, match="the wearer stopped it") as caught:
            d.present_current(FIRST, seconds=0.5, ttl_ms=150)
    assert not isinstance(caught.value, CutShort)


# --- begin ----------------------------------------------------------------------------------------


def test_a_presentation_goes_on_beside_the_program(rig: ServedRig) -> None:
    with display(rig) as d:
        underway = d.begin_current(FIRST, seconds=0.3)
        assert d.status().state == "SAFE", "the program goes on"
        with pytest.raises(TimeoutError):
            underway.wait(0.01)
        assert underway.wait().pulses == (6, 0, 0, 0)
        assert underway.is_over
    assert frames_of(rig)[-1].current_ua == (0, 0, 0, 0)


def test_another_frame_of_the_program_ends_it_and_nothing_of_it_comes_after(
    rig: ServedRig,
) -> None:
    with display(rig) as d:
        underway = d.begin_current(FIRST, seconds=2.0, ttl_ms=100)
        while not frames_of(rig):
            clock.sleep_s(0.005)
        d.show_current([0, 500, 0, 0])
        (why,) = [why for why in underway.wait().why_not if "pulses" not in why]
        assert why.startswith("another frame of the program replaced it")
        assert frames_of(rig)[-1].current_ua == (0, 500, 0, 0)


def test_what_the_program_shows_right_after_it_wins(rig: ServedRig) -> None:
    """Whichever of the two threads is faster."""
    for _ in range(10):
        with display(rig) as d:
            underway = d.begin_current(FIRST, seconds=2.0, ttl_ms=100)
            d.show_current([0, 500, 0, 0])
            with contextlib.suppress(Refused):  # not one of its frames was begun
                assert not underway.wait().as_asked
            assert frames_of(rig)[-1].current_ua == (0, 500, 0, 0)


def test_a_preview_leaves_it_alone(rig: ServedRig) -> None:
    with display(rig) as d:
        underway = d.begin_current(FIRST, seconds=0.3, ttl_ms=100)
        while not frames_of(rig):
            clock.sleep_s(0.005)
        d.preview([0, 1, 0, 0])
        underway.wait()
        assert len(frames_of(rig)) > 3


def test_it_can_be_ended_early(rig: ServedRig) -> None:
    with display(rig) as d:
        underway = d.begin_current(FIRST, seconds=20.0)
        while not frames_of(rig):
            clock.sleep_s(0.005)
        underway.end()
        assert underway.is_over
        (why,) = underway.wait().why_not
        assert why.startswith("it was ended")
        assert frames_of(rig)[-1].current_ua == (0, 0, 0, 0)


def test_what_it_is_refused_with_is_raised_by_wait(rig: ServedRig) -> None:
    def refusing(message: Command | NewFrame) -> Answer:
        if isinstance(message, NewFrame):
            return Answer(ref=message.ref, error="halted", reason="the wearer stopped it")
        return full_answer(message)

    with display(rig) as d:
        rig.engine.answer = refusing
        underway = d.begin_current(FIRST, seconds=1.0)
        with pytest.raises(Refused, match="the wearer stopped it"):
            underway.wait()


def test_a_program_that_may_hang_begins_nothing_endless(rig: ServedRig) -> None:
    with display(rig) as d, pytest.raises(Refused, match="at most 30 s"):
        d.begin_current(FIRST, seconds=31.0)


# --- kept -----------------------------------------------------------------------------------------


def keeps(rig: ServedRig) -> int:
    return sum(isinstance(command, KeepLease) for command in rig.engine.heard)


def test_a_lease_is_kept_over_a_pause_and_not_after_it(rig: ServedRig) -> None:
    with display(rig) as d:
        with d.kept():
            clock.sleep_s(1.0)
            assert keeps(rig) >= 2
        kept = keeps(rig)
        clock.sleep_s(0.5)
        assert keeps(rig) == kept
    assert "etd keeps" not in {thread.name for thread in threading.enumerate()}


def test_a_program_that_hangs_keeps_it_no_longer_than_it_was_to(rig: ServedRig) -> None:
    with display(rig) as d, d.kept(at_most_s=0.4):
        clock.sleep_s(0.5)
        kept = keeps(rig)
        clock.sleep_s(1.0)
        assert keeps(rig) == kept
        while keeps(rig) == kept:
            d.status()  # it comes by
            clock.sleep_s(0.05)


def test_what_ends_the_lease_meanwhile_is_raised_where_the_program_asks(rig: ServedRig) -> None:
    def lapsed(message: Command | NewFrame) -> Answer:
        if isinstance(message, (KeepLease, NewFrame)):
            return Answer(ref=message.ref, error="no_lease", reason="it lapsed")
        return full_answer(message)

    with display(rig) as d, d.kept():
        rig.engine.answer = lapsed
        clock.sleep_s(0.5)
        with pytest.raises(Refused, match=r"call arm\(\) first"):
            d.keep()


# --- the same, awaited ----------------------------------------------------------------------------


def test_the_asyncio_display_presents_begins_and_keeps(rig: ServedRig) -> None:
    async def script() -> None:
        async with AsyncDisplay(address=rig.address, max_current_ua=3000, width_us=100) as d:
            await d.arm()
            assert (await d.present_current(FIRST, seconds=0.05)).as_asked
            async with d.kept():
                await asyncio.sleep(0.7)
            assert keeps(rig) >= 1
            underway = d.begin({0: 1.0}, seconds=0.1)
            await d.status()
            assert (await underway).pulses == (6, 0, 0, 0)
            cut_short = d.begin({0: 1.0}, seconds=20.0)
            await asyncio.sleep(0.1)
            cut_short.cancel()
            with pytest.raises(asyncio.CancelledError):
                await cut_short
            assert (await d.preview({0: 1.0})).clamped == ()

    asyncio.run(script())
    assert frames_of(rig)[-1].level == (0, 0, 0, 0)
