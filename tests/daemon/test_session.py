"""A session by hand: one person and one calibration, from the first current on."""

from __future__ import annotations

from engine_parts import calibration
from etd.protocol.messages import SessionFacts
from etd.safety.session import UNUSED_NS, Sessions, Subject

S = 1_000_000_000
FIRST = Subject(calibration(participant="P01"))
SECOND = Subject(calibration(participant="P02"))
#: Two leases with limits: they do not say who they are for.
UNKNOWN, UNKNOWN_TOO = Subject(None, 1), Subject(None, 2)


def sessions() -> Sessions:
    return Sessions(has_wearer_stop=True)


def try_stop(sessions: Sessions, now_ns: int, *, is_to_stop: bool = False) -> None:
    sessions.stop_moved(is_open=True, is_to_stop=is_to_stop, now_ns=now_ns)
    sessions.stop_moved(is_open=False, is_to_stop=False, now_ns=now_ns + S)


def used(subject: Subject, since_ns: int, until_ns: int) -> Sessions:
    """The stop tried, the board live for so long, and safe again."""
    one = sessions()
    try_stop(one, since_ns - 2 * S)
    assert one.why_untried(subject, since_ns) is None
    one.went_live(subject, since_ns)
    one.went_safe(until_ns)
    return one


def test_before_the_first_current_no_session_stands() -> None:
    one = sessions()
    try_stop(one, 0)
    assert one.why_untried(FIRST, 2 * S) is None
    assert one.standing(2 * S) is None


def test_it_stands_while_the_board_is_live_and_ten_minutes_longer() -> None:
    one = sessions()
    try_stop(one, 0)
    one.went_live(FIRST, 2 * S)
    session = one.standing(5_000 * S)
    assert session is not None
    assert session.ends_in_ns(5_000 * S) is None
    one.went_safe(5_000 * S)
    assert session.ends_in_ns(5_060 * S) == 540 * S
    assert one.standing(5_000 * S + UNUSED_NS - 1) is session
    assert one.standing(5_000 * S + UNUSED_NS) is None
    assert UNUSED_NS == 600 * S


def test_what_status_says_of_it_is_who_and_the_time_that_is_left_to_a_tenth_of_a_second() -> None:
    one = sessions()
    assert one.facts(0) is None
    one.went_live(FIRST, S)
    assert one.facts(2 * S) == SessionFacts(participant="P01", ends_in_s=None)
    one.went_safe(2 * S)
    assert one.facts(302 * S - 50_000_100) == SessionFacts(participant="P01", ends_in_s=300.1)
    assert one.facts(302 * S - 49_999_900) == SessionFacts(participant="P01", ends_in_s=300.0)
    assert one.facts(2 * S + UNUSED_NS) is None


def test_only_the_first_current_begins_it() -> None:
    one = sessions()
    assert one.went_live(FIRST, S)
    one.went_safe(2 * S)
    assert not one.went_live(FIRST, 3 * S)
    session = one.standing(4 * S)
    assert session is not None
    assert session.begun_ns == S


def test_current_to_another_person_begins_another_one() -> None:
    one = used(FIRST, 10 * S, 20 * S)
    assert one.went_live(SECOND, 30 * S)
    session = one.standing(31 * S)
    assert session is not None
    assert (session.subject, session.begun_ns) == (SECOND, 30 * S)


def test_without_a_session_that_no_current_can_flow_changes_nothing() -> None:
    one = sessions()
    one.went_safe(S)
    assert one.standing(S) is None


def test_a_session_that_is_used_again_stands_for_as_long_as_the_board_is_live() -> None:
    one = used(FIRST, 0, S)
    one.went_live(FIRST, 2 * S)
    assert one.standing(2 * S + 2 * UNUSED_NS) is not None
    one.went_safe(3 * UNUSED_NS)
    one.went_safe(4 * UNUSED_NS - S)
    assert one.standing(4 * UNUSED_NS - 1) is not None
    assert one.standing(4 * UNUSED_NS) is None


def test_the_same_calibration_goes_on_with_its_session_whatever_the_lease() -> None:
    sessions = used(FIRST, 10 * S, 20 * S)
    again = Subject(calibration(participant="P01"))
    sessions.opened(again, 30 * S)
    assert sessions.why_untried(again, 30 * S) is None
    session = sessions.standing(30 * S)
    assert session is not None
    assert session.begun_ns == 10 * S


def test_another_person_or_another_calibration_of_the_same_one_begins_anew() -> None:
    for other in (SECOND, Subject(calibration(participant="P01", gamma=1.5))):
        sessions = used(FIRST, 10 * S, 20 * S)
        why = sessions.why_untried(other, 30 * S)
        assert why is not None
        assert "another person or calibration than the session of P01" in why
        assert "press and release it once" in why
        assert sessions.standing(30 * S) is None
        assert sessions.why_untried(FIRST, 31 * S) is not None


def test_of_a_lease_with_limits_it_is_not_known_whom_it_is_for() -> None:
    sessions = used(UNKNOWN, 10 * S, 20 * S)
    assert sessions.why_untried(UNKNOWN, 30 * S) is None
    why = sessions.why_untried(UNKNOWN_TOO, 30 * S)
    assert why is not None
    assert "no calibration" in why


def test_after_ten_minutes_without_use_it_is_asked_again_and_said_why() -> None:
    sessions = used(FIRST, 10 * S, 20 * S)
    why = sessions.why_untried(FIRST, 20 * S + UNUSED_NS)
    assert why is not None
    assert "the session of P01 ended after 10 minutes without use" in why


def test_a_try_between_two_sessions_counts_for_the_next_one() -> None:
    """An application that was refused may be started anew after it."""
    sessions = used(FIRST, 10 * S, 20 * S)
    assert sessions.why_untried(SECOND, 30 * S) is not None
    try_stop(sessions, 40 * S)
    assert sessions.why_untried(SECOND, 50 * S) is None
    sessions.went_live(SECOND, 50 * S)
    sessions.went_safe(60 * S)
    assert sessions.why_untried(UNKNOWN, 61 * S) is not None


def test_a_try_is_used_up_by_the_session_that_goes_live_after_it() -> None:
    sessions = used(FIRST, 10 * S, 20 * S)
    try_stop(sessions, 25 * S)
    sessions.went_live(FIRST, 30 * S)
    sessions.went_safe(40 * S)
    assert sessions.why_untried(SECOND, 41 * S) is not None


def test_a_try_ages() -> None:
    one = sessions()
    try_stop(one, 0)
    assert one.why_untried(FIRST, UNUSED_NS) is None
    why = one.why_untried(FIRST, S + UNUSED_NS)
    assert why is not None
    assert "more than 10 minutes ago" in why


def test_a_stop_that_ended_something_was_pressed_for_that() -> None:
    one = sessions()
    try_stop(one, 0)
    one.went_live(UNKNOWN, 5 * S)
    one.went_safe(10 * S)
    try_stop(one, 10 * S, is_to_stop=True)
    assert one.why_untried(UNKNOWN_TOO, 20 * S) is not None


def test_a_stop_line_ends_the_session_that_stands_and_says_so() -> None:
    one = used(FIRST, 10 * S, 20 * S)
    one.stopped("wearer_stop")
    why = one.why_untried(FIRST, 25 * S)
    assert why is not None
    assert "wearer_stop ended the session of P01" in why
    none = sessions()
    none.stopped("wearer_stop")
    why = none.why_untried(FIRST, S)
    assert why is not None
    assert "there was none since the engine started" in why


def test_a_test_of_the_stop_under_a_lease_is_that_leases() -> None:
    for other in (SECOND, UNKNOWN, UNKNOWN_TOO):
        one = sessions()
        one.opened(FIRST, 0)
        try_stop(one, S)
        one.closed()
        assert one.why_untried(FIRST, 5 * S) is None, "the same person once more"
        assert one.why_untried(other, 6 * S) is not None
        assert one.why_untried(FIRST, 7 * S) is not None, "it is gone"


def test_a_test_of_the_stop_between_two_leases_is_the_next_ones() -> None:
    one = sessions()
    one.opened(UNKNOWN, 0)
    one.closed()
    try_stop(one, S)
    assert one.why_untried(UNKNOWN_TOO, 5 * S) is None


def test_a_release_counts_once() -> None:
    """A contact that bounces, or a lead that is plugged in again, is no second try."""
    one = used(FIRST, 10 * S, 20 * S)
    one.closed()
    one.stop_moved(is_open=False, is_to_stop=False, now_ns=25 * S)
    assert one.why_untried(SECOND, 30 * S) is not None


def test_a_stop_that_was_only_plugged_in_has_not_been_tried() -> None:
    one = sessions()
    one.stop_moved(is_open=False, is_to_stop=False, now_ns=0)
    assert one.why_untried(FIRST, S) is not None


def test_a_board_without_the_stop_asks_for_nothing_and_has_sessions_all_the_same() -> None:
    sessions = Sessions(has_wearer_stop=False)
    assert sessions.why_untried(FIRST, S) is None
    sessions.went_live(FIRST, S)
    assert sessions.standing(2 * S) is not None
