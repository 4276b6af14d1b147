"""A clock that a test moves by hand, in the place of the real one.

Owns: how late it wakes, and what holds the machine up. Must not know: what is tested.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from etd_hal.ports import Wait

MS = 1_000_000


class HandClock:
    """A real clock that stands still unless slept on; sleeps wake `late_ns` late. Whenever it is
    read, the machine has been held up by the next of `stalls_ns`.
    """

    def __init__(self, late_ns: int = 0, stalls_ns: Sequence[int] = ()) -> None:
        self.t_ns = 5_000 * MS
        self.late_ns = late_ns
        self._stalls_ns = list(stalls_ns)
        #: In the place of a sleep, until a test has had enough of it.
        self.asleep: Callable[[int], None] | None = None

    def now_ns(self) -> int:
        if self._stalls_ns:
            self.t_ns += self._stalls_ns.pop()
        return self.t_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        if self.asleep is not None:
            self.asleep(deadline_ns)
        elif deadline_ns > self.t_ns:
            self.t_ns = deadline_ns + self.late_ns

    def doze_until_ns(self, deadline_ns: int) -> None:
        self.sleep_until_ns(deadline_ns)

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        if not wait((deadline_ns - self.t_ns) / 1e9):
            self.sleep_until_ns(deadline_ns)
