"""What slows the machine down while the engine runs: heat, or a supply that is too weak.

Owns: how often the machine is asked, and what was found. Must not know: where the answer comes
from, what is done about it.

Asking takes up to a millisecond, since the firmware answers: it is done between two scans only.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

_EVERY_NS = 5_000_000_000


class MachineWatch:
    """See the module. `counters` gets how often a trouble began."""

    def __init__(self, ask: Callable[[], tuple[str, ...]], counters: Counter[str]) -> None:
        self._ask = ask
        self._counters = counters
        self._next_ns = 0
        #: A sentence each.
        self.troubles: tuple[str, ...] = ()

    def look(self, now_ns: int) -> bool:
        """Whether anything has changed; the machine is asked every few seconds at most."""
        if now_ns < self._next_ns:
            return False
        self._next_ns = now_ns + _EVERY_NS
        before, self.troubles = self.troubles, self._ask()
        begun = set(self.troubles) - set(before)
        if begun:
            self._counters["machine_slowed"] += len(begun)
        return self.troubles != before
