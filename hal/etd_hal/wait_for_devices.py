"""Opens hardware whose devices the system may still be setting up.

Owns: how often it is tried, until when, and what is reported meanwhile. Must not know: which
hardware it is, which program waits.

A service may be started before the system has made a device's node, or given it to its group.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from etd_hal.errors import HardwareMissing
from etd_hal.ports import Clock

T = TypeVar("T")

_LOOK_AGAIN_NS = 250_000_000


def open_when_there(
    open_all: Callable[[], T], clock: Clock, wait_ns: int, tell: Callable[[str], object]
) -> T:
    """Returns what `open_all` returns, once it succeeds.

    It is called again for up to `wait_ns`, as long as all that is missing may still come; `tell`
    gets what is missing, each time that changes, and when all is there. Raises: HardwareMissing, at
    once where waiting cannot help.
    """
    begun_ns = clock.now_ns()
    told: tuple[str, ...] = ()
    while True:
        try:
            opened = open_all()
        except HardwareMissing as missing:
            now_ns = clock.now_ns()
            left_ns = begun_ns + wait_ns - now_ns
            if left_ns <= 0 or not missing.may_come:
                raise
            if missing.problems != told:
                told = missing.problems
                tell(f"waiting {left_ns / 1e9:.1f} s at most for: {'; '.join(told)}")
            clock.doze_until_ns(now_ns + min(_LOOK_AGAIN_NS, left_ns))
        else:
            if told:
                tell(f"all devices are there after {(clock.now_ns() - begun_ns) / 1e9:.1f} s")
            return opened
