"""The fake's time, against a real clock that a test moves by hand."""

from __future__ import annotations

import threading

from hypothesis import given
from hypothesis import strategies as st

from etd_hal.fake.clock import LiveClock, SteppedClock
from hand_clock import HandClock

MS = 1_000_000


class TestSteppedClock:
    def test_time_passes_only_by_being_spent_or_slept(self) -> None:
        clock = SteppedClock(start_ns=100)
        assert (clock.now_ns(), clock.now_ns()) == (100, 100)
        clock.spend(50)
        clock.sleep_until_ns(400)
        assert clock.now_ns() == 400

    def test_a_sleep_into_the_past_changes_nothing(self) -> None:
        clock = SteppedClock(start_ns=100)
        clock.sleep_until_ns(20)
        assert clock.now_ns() == 100

    def test_actions_run_at_their_times_in_order(self) -> None:
        clock = SteppedClock(start_ns=0)
        seen: list[tuple[str, int]] = []
        clock.at(70, lambda: seen.append(("late", clock.now_ns())))
        clock.at(30, lambda: seen.append(("first", clock.now_ns())))
        clock.at(30, lambda: seen.append(("second", clock.now_ns())))
        clock.sleep_until_ns(69)
        assert seen == [("first", 30), ("second", 30)]
        clock.spend(1)
        assert seen[2] == ("late", 70)

    def test_a_doze_ends_with_the_action_that_brings_what_is_waited_for(self) -> None:
        clock = SteppedClock(start_ns=0)
        came: list[int] = []
        clock.at(30, lambda: None)
        clock.at(70, lambda: came.append(clock.now_ns()))
        clock.doze_until_woken(400, lambda _: bool(came))
        assert clock.now_ns() == 70
        clock.doze_until_woken(400, lambda _: bool(came))
        assert clock.now_ns() == 70, "it is still there"
        clock.doze_until_woken(400, lambda _: False)
        assert clock.now_ns() == 400


class TestLiveClock:
    def test_a_call_lasts_exactly_as_long_as_the_model_says(self) -> None:
        real = HandClock(late_ns=37_000)
        clock = LiveClock(real)
        begun_ns = clock.begin_message()
        real.t_ns += 60_000
        clock.end_call(begun_ns + 112_062)
        assert clock.now_ns() - begun_ns == 112_062

    def test_waking_late_shows_as_lag_and_the_next_sleep_takes_it_back(self) -> None:
        real = HandClock(late_ns=300_000)
        clock = LiveClock(real)
        clock.end_call(clock.begin_message() + 100_000)
        assert real.t_ns - clock.now_ns() == 300_000
        real.late_ns = 0
        clock.sleep_until_ns(clock.now_ns() + 500_000)
        assert real.t_ns == clock.now_ns()

    def test_a_stall_stays_as_lag_and_time_goes_on_from_there(self) -> None:
        real = HandClock()
        clock = LiveClock(real)
        clock.end_call(clock.begin_message() + 100_000)
        begun_ns = clock.now_ns()
        real.t_ns += 5_000 * MS
        for _ in range(3):
            clock.sleep_until_ns(clock.now_ns() + 1 * MS)
        assert clock.now_ns() - begun_ns == 3 * MS
        assert real.t_ns - clock.now_ns() == 4_999 * MS, "only the first one did not wait"

    @given(st.lists(st.integers(0, 5_000 * MS), max_size=40), st.integers(0, 300 * MS))
    def test_no_message_rest_or_sleep_is_longer_for_a_machine_that_is_held_up(
        self, stalls_ns: list[int], late_ns: int
    ) -> None:
        clock = LiveClock(HandClock(late_ns, stalls_ns))
        for _ in range(6):
            begun_ns = clock.now_ns()
            clock.end_call(clock.begin_message() + 112_062)
            assert clock.now_ns() - begun_ns == 112_062
            clock.sleep_until_ns(begun_ns + 312_062)
            assert clock.now_ns() - begun_ns == 312_062

    def test_a_doze_that_is_woken_ends_at_the_time_of_the_real_clock(self) -> None:
        real = HandClock()
        clock = LiveClock(real)
        clock.end_call(clock.begin_message() + 100_000)
        begun_ns = clock.now_ns()

        def wait(timeout_s: float) -> bool:
            real.t_ns += 300_000
            return True

        clock.doze_until_woken(begun_ns + 1 * MS, wait)
        assert clock.now_ns() - begun_ns == 300_000

    def test_a_doze_that_nothing_wakes_ends_at_its_deadline_as_a_sleep_does(self) -> None:
        real = HandClock()
        clock = LiveClock(real)
        clock.end_call(clock.begin_message() + 100_000)
        begun_ns = clock.now_ns()

        def wait(timeout_s: float) -> bool:
            real.t_ns += round(timeout_s * 1e9) + 20_000
            return False

        clock.doze_until_woken(begun_ns + 1 * MS, wait)
        assert clock.now_ns() - begun_ns == 1 * MS
        assert real.t_ns == clock.now_ns()
        clock.doze_until_woken(begun_ns, lambda _: True)
        assert clock.now_ns() - begun_ns == 1 * MS

    def test_another_thread_that_watches_a_message_sees_it_end_in_time(self) -> None:
        real = HandClock()
        clock = LiveClock(real)
        begun_ns = clock.begin_message()
        seen_ns: list[int] = []

        def stalled(deadline_ns: int) -> None:
            real.t_ns = deadline_ns + 5_000 * MS
            seen_ns.append(clock.now_ns() - begun_ns)

        real.asleep = stalled
        clock.end_call(begun_ns + 100_000)
        seen_ns.append(clock.now_ns() - begun_ns)
        assert seen_ns == [100_000, 100_000]

    def test_another_threads_sleep_does_not_move_time(self) -> None:
        real = HandClock()
        clock = LiveClock(real)
        begun_ns = clock.begin_message()
        clock.end_call(begun_ns + 100_000)
        seen: list[int] = []

        def sleep_while_the_player_goes_on(deadline_ns: int) -> None:
            real.t_ns = max(real.t_ns, deadline_ns)
            seen.append(clock.now_ns() - begun_ns)
            if len(seen) == 2:
                real.asleep = None
                clock.end_call(begun_ns + 21 * MS)

        def sensor() -> None:
            real.asleep = sleep_while_the_player_goes_on
            clock.sleep_until_ns(begun_ns + 20 * MS)
            seen.append(clock.now_ns() - begun_ns)

        thread = threading.Thread(target=sensor)
        thread.start()
        thread.join(5.0)
        assert seen == [100_000, 100_000, 21 * MS]

    def test_while_a_call_waits_others_do_not_see_its_end_yet(self) -> None:
        real = HandClock()
        clock = LiveClock(real)
        begun_ns = clock.begin_message()
        seen: list[int] = []

        def wait_and_look(deadline_ns: int) -> None:
            real.t_ns = deadline_ns - 40_000
            seen.append(clock.now_ns() - begun_ns)
            real.t_ns = deadline_ns

        real.asleep = wait_and_look
        clock.end_call(begun_ns + 100_000)
        assert seen == [60_000]

    def test_a_side_call_takes_time_only_for_who_makes_it(self) -> None:
        real = HandClock()
        clock = LiveClock(real)
        begun_ns = clock.begin_message()
        clock.end_side_call(begun_ns + 2 * MS)
        assert clock.now_ns() == begun_ns
        assert real.t_ns == begun_ns + 2 * MS

    def test_while_the_player_sleeps_others_see_time_go_on(self) -> None:
        real = HandClock()
        clock = LiveClock(real)
        clock.begin_message()
        start_ns = clock.now_ns()
        seen: list[int] = []

        def sleep_and_look(deadline_ns: int) -> None:
            real.t_ns = deadline_ns - 1 * MS
            seen.append(clock.now_ns() - start_ns)
            real.t_ns = deadline_ns

        real.asleep = sleep_and_look
        clock.sleep_until_ns(start_ns + 8 * MS)
        assert seen == [7 * MS]

    @given(
        st.lists(
            st.tuples(
                st.sampled_from(["call", "sleep", "compute", "side"]), st.integers(0, 200 * MS)
            ),
            max_size=30,
        ),
        st.integers(0, 20 * MS),
    )
    def test_it_never_leads_and_never_goes_back(
        self, steps: list[tuple[str, int]], late_ns: int
    ) -> None:
        real = HandClock(late_ns)
        clock = LiveClock(real)
        before_ns = clock.now_ns()
        for kind, duration_ns in steps:
            if kind == "call":
                clock.end_call(clock.begin_message() + duration_ns)
            elif kind == "side":
                clock.end_side_call(clock.begin_call("line") + duration_ns)
            elif kind == "sleep":
                clock.sleep_until_ns(clock.now_ns() + duration_ns)
            else:
                real.t_ns += duration_ns
            assert before_ns <= clock.now_ns() <= real.t_ns
            before_ns = clock.now_ns()
