"""How a self-test is interrupted: by the first signal, and only once.

Owns: what the signals do while a self-test runs, and for how long a further one has to wait. Must
not know: how a board is made safe.

The first signal raises KeyboardInterrupt, and whoever is broken off by that makes the board safe.
From then on no signal does anything: two that follow each other, as Ctrl-C pressed twice or a
service that is stopped, would leave the supply on. That is bounded: the way to the safe state takes
milliseconds, and after `MOST_S` an alarm breaks off whatever it hangs in. Nothing is printed from
within a signal handler: a slow terminal would make the board wait.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: Ctrl-C, a service manager or a kill, a terminal that is gone, Ctrl-\ and Ctrl-Z.
_ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
#: For the way to the safe state.
MOST_S = 10.0


class _Ending:
    """The signals since the test began."""

    def __init__(self) -> None:
        self.came = 0
        self.is_overdue = False

    def ask(self, _number: int, _frame: FrameType | None) -> None:
        self.came += 1
        if self.came == 1:
            signal.setitimer(signal.ITIMER_REAL, MOST_S)
            raise KeyboardInterrupt

    def overdue(self, _number: int, _frame: FrameType | None) -> None:
        self.is_overdue = True
        raise KeyboardInterrupt

    def tell(self) -> None:
        if self.is_overdue:
            said = f"not ended {MOST_S:.0f} s after it was asked to: unless it says above that the"
            said += " board is in its safe state, cut the supply by hand"
            print(f"etd selftest: {said}", file=sys.stderr)
        elif self.came > 1:
            said = f"{self.came - 1} more signals came meanwhile, and waited for that"
            print(f"etd selftest: {said}", file=sys.stderr)


@contextmanager
def broken_off_once() -> Iterator[None]:
    """While a board is tested. In the main thread."""
    ending = _Ending()
    before = {signals: signal.signal(signals, ending.ask) for signals in _ENDINGS}
    before[signal.SIGALRM] = signal.signal(signal.SIGALRM, ending.overdue)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for one, handler in before.items():
            signal.signal(one, handler)
        ending.tell()
