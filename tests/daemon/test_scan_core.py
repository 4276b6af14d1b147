"""What the kernel says of the scan's core, with its age: an old answer is none."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from etd.sensing.readings import Readings
from etd.sensing.scan_core import CORE_SLOT, STALE_NS, ScanCoreReading
from etd_hal.bench import UNKNOWN_CORE, ScanCore
from etd_hal.fake.clock import SteppedClock

MS = 1_000_000
ALONE = ScanCore(3, is_isolated=True, has_throttle=False, has_fair_server=False)
THROTTLED = ScanCore(3, is_isolated=True, has_throttle=True, has_fair_server=False)


class Both:
    """The side that reads, and the side that asks."""

    def __init__(self) -> None:
        self.clock = SteppedClock()
        self.now = ALONE
        self.asked = 0
        readings = Readings(CORE_SLOT + 1)
        self.reader = ScanCoreReading(readings, self.clock, self._ask)
        self.asker = ScanCoreReading(Readings(CORE_SLOT + 1, readings.memory), self.clock)

    def _ask(self) -> ScanCore:
        self.asked += 1
        return self.now

    @property
    def is_left_alone(self) -> bool:
        return self.asker.is_left_alone(self.clock.now_ns())


def test_what_was_not_read_is_not_known() -> None:
    both = Both()
    assert not both.is_left_alone
    assert "not known" in both.asker.told(both.clock.now_ns())
    both.reader.read()
    assert both.is_left_alone
    assert both.asker.told(both.clock.now_ns()) == str(ALONE)


def test_it_is_read_four_times_a_second() -> None:
    both = Both()
    for _ in range(1_000):
        both.reader.read()
        both.clock.spend(2 * MS)
    assert both.asked == 8


@given(since_ns=st.integers(0, 2_000 * MS))
def test_an_answer_of_more_than_half_a_second_ago_is_none(since_ns: int) -> None:
    both = Both()
    both.reader.read()
    both.clock.spend(since_ns)
    assert both.is_left_alone is (since_ns <= STALE_NS)


@given(st.lists(st.tuples(st.sampled_from([ALONE, THROTTLED, UNKNOWN_CORE]), st.integers(1, 400))))
def test_a_core_is_alone_only_as_long_as_each_answer_of_the_last_half_second_says_so(
    course: list[tuple[ScanCore, int]],
) -> None:
    both = Both()
    for now, lasts_ms in course:
        both.now = now
        for _ in range(lasts_ms):
            both.reader.read()
            both.clock.spend(MS)
        if lasts_ms > 250:
            assert both.is_left_alone is now.is_left_alone
            assert both.asker.told(both.clock.now_ns()) == str(now)
