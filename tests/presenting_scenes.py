"""Presentations on stepped time: an opened display, pauses, and the judge of what it is told.

Owns: the client's side of such a scene, and that an account is what flowed. Must not know: which
script is played.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import pytest

from etd.client.course import Course, Ended, Pause
from etd.client.presented import Presented
from etd.protocol.errors import Refused
from stepped_daemon import SteppedDaemon, SteppedDisplay
from trace_decoder import Phase

R = TypeVar("R")
N = 8
CAP_UA, WIDTH_US = 3_000, 100
STEP_UA = 10_000 / 4_095
SECOND_NS = 1_000_000_000


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


def meanwhile(course: Course[R], number: int, happen: Callable[[], object]) -> Course[R]:
    """Something happens before the pause of this number, from 1; what it raises ends that pause."""
    try:
        step, pauses = next(course), 0
        while True:
            pauses += isinstance(step, Pause)
            try:
                if isinstance(step, Pause) and pauses == number:
                    happen()
                done = yield step
            except (Refused, Ended) as error:
                step = course.throw(error)
            else:
                step = course.send(done)
    except StopIteration as end:
        result: R = end.value
        return result


def flowed(daemon: SteppedDaemon, presented: Presented, since_ns: int = 0) -> list[Phase]:
    """Pulses of its frames; those at electrodes that they leave silent are looks. `since_ns`: the
    frames of an earlier lease have the same numbers.
    """
    return [
        phase
        for phase in daemon.followed.phases()
        if phase.from_ns >= since_ns
        and phase.seq in presented.seqs
        and presented.wanted_ua[phase.electrode or 0]
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
