"""How a self-test is interrupted: by the first signal, and only once.

Owns: what signals do while a self-test runs. Must not know: how a board is made safe.

The first signal raises KeyboardInterrupt; the code it interrupts makes the board safe. Further
signals are ignored: a second one, from Ctrl-C pressed twice or a service that is stopped, would
interrupt that and leave the supply on. Making the board safe takes milliseconds; after `MOST_S` an
alarm interrupts it, in case it hangs. Signal handlers print nothing: a slow terminal would delay
the safe state.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: Ctrl-C, a service manager or a kill, a terminal that is gone, Ctrl-\ and Ctrl-Z.
_ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
#: The most that making the board safe may take.
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
            print(
                f"etd selftest: it did not end within {MOST_S:.0f} s of the signal: cut the supply"
                " by hand, unless a line above says that the board is in its safe state",
                file=sys.stderr,
            )
        elif self.came > 1:
            print(f"etd selftest: {self.came - 1} more signals were ignored", file=sys.stderr)


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
