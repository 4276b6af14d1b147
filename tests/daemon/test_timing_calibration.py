"""How often a timing is measured anew: attempts, pauses, and when there are no more."""

from __future__ import annotations

from collections import Counter

import pytest

from board_rig import BoardRig, board_rig
from etd.engine.timing_calibration import ATTEMPTS, Retiming, calibrate_at_start, limitations
from etd_hal.errors import BoardFault
from etd_hal.fake.faults import SlowWords

S = 1_000_000_000
#: Within what is plausible of a word, and beyond.
SLOWER, TOO_SLOW = SlowWords(5), SlowWords(200)


@pytest.fixture
def rig() -> BoardRig:
    rig = board_rig()
    rig.begin()
    return rig


def retiming(rig: BoardRig) -> tuple[Retiming, Counter[str]]:
    counters: Counter[str] = Counter()
    return Retiming(rig.board, counters, lambda: None), counters


def with_two_speeds(rig: BoardRig) -> BoardRig:
    """Only then is one recognized: with one alone no change of speed explains a drift."""
    one, _ = retiming(rig)
    rig.fake.world.put_in(SLOWER)
    assert one.attempt(0)
    rig.fake.world.mend()
    assert one.attempt(0)
    return rig


def test_a_timing_that_holds_is_recognized_and_counts_for_nothing(rig: BoardRig) -> None:
    one, counters = retiming(with_two_speeds(rig))
    before = rig.board.timing
    assert one.attempt(0)
    assert rig.board.timing is before
    assert counters == {}
    assert one.not_before_ns == 0


def test_a_timing_that_has_changed_is_measured_anew(rig: BoardRig) -> None:
    one, counters = retiming(rig)
    before = rig.board.timing
    rig.fake.world.put_in(SLOWER)
    assert one.attempt(0)
    assert rig.board.timing is not before
    assert counters == {"recalibrated": 1}


def test_one_that_held_before_is_a_step_of_the_clock(rig: BoardRig) -> None:
    one, counters = retiming(rig)
    rig.fake.world.put_in(SLOWER)
    assert one.attempt(0)
    rig.fake.world.mend()
    assert one.attempt(0)
    assert counters == {"recalibrated": 1, "clock_steps": 1}
    assert limitations(counters) != ()
    assert limitations(Counter(recalibrated=1)) == ()


def failing(one: Retiming, attempts: int) -> None:
    """So many in vain, and no one more than a second after another."""
    for number in range(attempts):
        assert not one.attempt(number * 7)
        assert one.not_before_ns == number * 7 + S


def test_the_third_attempt_in_vain_is_a_fault_and_after_it_there_are_three_again(
    rig: BoardRig,
) -> None:
    one, counters = retiming(rig)
    rig.fake.world.put_in(TOO_SLOW)
    for attempts in (3, 6):
        failing(one, ATTEMPTS - 1)
        with pytest.raises(BoardFault, match="timing calibration"):
            one.attempt(0)
        assert counters == {"calibration_attempts_failed": attempts}


@pytest.mark.parametrize("is_known", [True, False], ids=["recognized", "measured anew"])
def test_after_a_timing_that_holds_there_are_three_attempts_again(
    rig: BoardRig, is_known: bool
) -> None:
    one, counters = retiming(with_two_speeds(rig) if is_known else rig)
    rig.fake.world.put_in(TOO_SLOW)
    failing(one, ATTEMPTS - 1)
    rig.fake.world.mend()
    assert one.attempt(0)
    assert counters["recalibrated"] == int(not is_known)
    rig.fake.world.put_in(TOO_SLOW)
    failing(one, ATTEMPTS - 1)


def test_before_each_message_that_is_timed_something_else_may_be_done(rig: BoardRig) -> None:
    done: list[None] = []
    one = Retiming(with_two_speeds(rig).board, Counter(), lambda: done.append(None))
    assert one.attempt(0)
    few = len(done)
    assert few > 0
    rig.fake.world.put_in(TOO_SLOW)
    assert not one.attempt(0)
    assert len(done) > 3 * few


def test_at_the_start_each_attempt_is_told_and_a_second_lies_between_them() -> None:
    rig, told = board_rig(), list[str]()
    assert rig.board.safe_off() == ()
    assert calibrate_at_start(rig.board, rig.clock, told.append) == ()
    rig.fake.world.put_in(TOO_SLOW)
    begun_ns = rig.clock.now_ns()
    with pytest.raises(BoardFault, match="timing calibration"):
        calibrate_at_start(rig.board, rig.clock, told.append)
    assert [said.partition(":")[0] for said in told] == [
        f"attempt {number} of 3" for number in (1, 2, 3)
    ]
    assert 2 * S < rig.clock.now_ns() - begun_ns < 3 * S
