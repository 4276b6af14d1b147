"""One board's time line: calls come one after another, and their events in order.

Owns: the time of the last thing that happened, and the list of rules that were broken.
Must not know: clocks, what happens.
"""

from __future__ import annotations

from collections.abc import Callable

from etd_hal.fake.trace import Trace

_MOST_VIOLATIONS = 100


class Timeline:
    def __init__(self, start_ns: int, trace: Trace) -> None:
        self.now_ns = start_ns
        self.violations: list[str] = []
        #: Called with the time of each call's start: what went on by itself since the last one.
        self.before_call: list[Callable[[int], None]] = []
        #: How far something has come by itself: a call that was broken off leaves it ahead.
        self.reached: list[Callable[[], int]] = []
        self._trace = trace

    def start(self, t_ns: int) -> int:
        """When a call that comes at `t_ns` really starts: never before what already happened."""
        # Comparisons: this is called for every line that changes, and `max` takes three times as
        # long.
        if t_ns < self.now_ns:
            t_ns = self.now_ns
        for reached_ns in self.reached:
            own_ns = reached_ns()
            if t_ns < own_ns:
                t_ns = own_ns
        for follow in self.before_call:
            follow(t_ns)
        self.now_ns = t_ns
        return t_ns

    def end(self, t_ns: int) -> int:
        """The call is over at `t_ns`; its events go on file."""
        if self.now_ns < t_ns:
            self.now_ns = t_ns
        self._trace.write()
        return t_ns

    def complain(self, t_ns: int, what: str) -> None:
        """A rule was broken; the first hundred are kept."""
        if len(self.violations) < _MOST_VIOLATIONS:
            self.violations.append(f"{t_ns} ns: {what}")
