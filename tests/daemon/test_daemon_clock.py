"""What a client on another computer knows of the daemon's clock."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from etd.client.daemon_clock import DaemonClock
from etd.client.session import Session

MS = 1_000_000
SECOND_NS = 1_000_000_000

#: How long before this exchange, the way there, the way back; in ns.
exchanges = st.lists(
    st.tuples(st.integers(0, 600 * SECOND_NS), st.integers(0, 500 * MS), st.integers(0, 500 * MS)),
    min_size=1,
    max_size=20,
)
offsets = st.integers(-(10**15), 10**15)


@given(offsets, exchanges)
def test_the_offset_lies_within_what_is_said(
    offset_ns: int, script: list[tuple[int, int, int]]
) -> None:
    known, now_ns = DaemonClock(is_here=False), 10**12
    for pause_ns, there_ns, back_ns in script:
        sent_ns = now_ns = now_ns + pause_ns
        now_ns += there_ns + back_ns
        known.observe(sent_ns, now_ns, sent_ns + there_ns + offset_ns)
        assert abs(known.offset_ns - offset_ns) <= known.uncertainty_ns + 1
        assert known.uncertainty_ns <= (there_ns + back_ns) // 2 + 1


@given(offsets, exchanges)
def test_a_stamp_is_never_later_than_it_was(
    offset_ns: int, script: list[tuple[int, int, int]]
) -> None:
    """A frame would be shown for longer than its ttl, or be refused as one from the future."""
    known, now_ns = DaemonClock(is_here=False), 10**12
    for pause_ns, there_ns, back_ns in script:
        sent_ns = now_ns = now_ns + pause_ns
        now_ns += there_ns + back_ns
        known.observe(sent_ns, now_ns, sent_ns + there_ns + offset_ns)
        assert known.at_least_ns(now_ns) <= now_ns + offset_ns


def test_quick_exchanges_make_it_narrow_and_time_makes_it_wider() -> None:
    known = DaemonClock(is_here=False)
    known.observe(0, 100 * MS, 50 * MS)
    assert known.uncertainty_ns == 50 * MS
    known.observe(200 * MS, 202 * MS, 201 * MS)
    assert known.uncertainty_ns == MS
    # 100 ppm of 100 s are 10 ms, either way.
    known.observe(100 * SECOND_NS, 101 * SECOND_NS, 100 * SECOND_NS + 500 * MS)
    assert 10 * MS < known.uncertainty_ns < 12 * MS


def test_a_clock_that_has_slept_is_learned_anew() -> None:
    """CLOCK_MONOTONIC stands still while a laptop sleeps."""
    known = DaemonClock(is_here=False)
    known.observe(0, 2 * MS, MS)
    known.observe(SECOND_NS, SECOND_NS + 2 * MS, 3_600 * SECOND_NS)
    assert abs(known.offset_ns - 3_599 * SECOND_NS) <= 2 * MS
    assert known.uncertainty_ns == MS


def test_on_the_same_machine_both_clocks_are_one() -> None:
    known = DaemonClock(is_here=True)
    known.observe(0, 100 * MS, 7 * SECOND_NS)
    assert (known.offset_ns, known.uncertainty_ns, known.at_least_ns(5)) == (0, 0, 5)


def test_frames_are_stamped_by_it() -> None:
    session = Session("test", max_current_ua=1_000, width_us=100)
    session.lease = "a"
    session.daemon_clock = DaemonClock(is_here=False)
    session.daemon_clock.observe(0, 2 * MS, 7 * SECOND_NS)
    sent = next(session.frame({"level": [0.0], "sent_ns": 5 * MS}))
    # Less what the clocks may have drifted apart in 3 ms.
    assert json.loads(sent.data)["sent_ns"] == 7 * SECOND_NS + 3 * MS - 300


def test_a_stamp_after_a_long_pause_allows_for_the_drift() -> None:
    known = DaemonClock(is_here=False)
    known.observe(0, 0, 0)
    assert known.at_least_ns(100 * SECOND_NS) == 100 * SECOND_NS - 10 * MS
