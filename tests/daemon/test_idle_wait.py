"""Between two polls: a message ends the wait, and messages without end do not take the time."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from etd.engine.idle_wait import TICK_NS, IdleWait
from etd_hal.fake.clock import SteppedClock

US = 1_000
SHORTEST_NS = 50 * US


@dataclass
class Waiting:
    """A wait where messages come when a test says so."""

    clock: SteppedClock
    is_there: bool = False

    def __call__(self, timeout_s: float) -> bool:
        assert timeout_s == 0.0, "in stepped time nothing comes while it is waited"
        return self.is_there

    def comes_at(self, t_ns: int) -> None:
        self.clock.at(t_ns, self._come)

    def _come(self) -> None:
        self.is_there = True


class Scene:
    def __init__(self) -> None:
        self.clock = SteppedClock(start_ns=0)
        self.messages = Waiting(self.clock)
        self.waits = IdleWait(self.clock, self.messages)

    def wait(self) -> bool:
        """A tick of it, from now on."""
        return self.waits.until_ns(self.clock.now_ns() + TICK_NS)

    def read(self, work_ns: int) -> None:
        """What came is read, and worked on for so long."""
        self.messages.is_there = False
        self.clock.spend(work_ns)


def test_without_a_message_it_lasts_a_tick() -> None:
    scene = Scene()
    assert [scene.wait() for _ in range(3)] == [False] * 3
    assert scene.clock.now_ns() == 3 * TICK_NS == 3_000 * US


def test_a_message_ends_it_when_it_comes() -> None:
    scene = Scene()
    scene.messages.comes_at(400 * US)
    assert scene.wait()
    assert scene.clock.now_ns() == 400 * US


def test_a_message_that_has_come_before_is_not_waited_for() -> None:
    scene = Scene()
    scene.messages.is_there = True
    assert scene.wait()
    assert scene.clock.now_ns() == 0


def test_after_work_for_a_message_the_next_one_waits_three_times_as_long() -> None:
    scene = Scene()
    scene.messages.comes_at(400 * US)
    scene.wait()
    scene.read(100 * US)
    scene.messages.comes_at(600 * US)
    assert scene.wait()
    assert scene.clock.now_ns() == 800 * US


def test_after_long_work_a_whole_tick_is_slept() -> None:
    scene = Scene()
    scene.messages.comes_at(0)
    scene.wait()
    scene.read(5_000 * US)
    scene.messages.is_there = True
    assert not scene.wait()
    assert scene.clock.now_ns() == 6_000 * US


def test_after_a_wait_that_no_message_ended_the_next_message_is_heard_at_once() -> None:
    scene = Scene()
    scene.messages.comes_at(400 * US)
    scene.wait()
    scene.read(300 * US)
    scene.wait()
    scene.clock.spend(700 * US)
    scene.messages.comes_at(scene.clock.now_ns() + 10 * US)
    assert scene.wait()
    assert scene.clock.now_ns() == 2_410 * US


def test_a_deadline_that_has_passed_is_no_wait() -> None:
    scene = Scene()
    scene.clock.spend(50 * US)
    scene.messages.is_there = True
    assert not scene.waits.until_ns(20 * US)
    assert scene.clock.now_ns() == 50 * US


@given(st.lists(st.integers(0, 3_000), min_size=20, max_size=80))
def test_messages_without_end_take_a_quarter_of_the_time_or_leave_a_tick_after_each(
    works_us: list[int],
) -> None:
    scene = Scene()
    scene.messages.is_there = True
    scene.wait()
    for work_us in works_us:
        scene.clock.spend(work_us * US)
        begun_ns = scene.clock.now_ns()
        scene.wait()
        slept_ns = scene.clock.now_ns() - begun_ns
        assert slept_ns == min(TICK_NS, max(SHORTEST_NS, 3 * work_us * US))
