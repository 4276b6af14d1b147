"""The largest weight that each electrode had as a return within the last second.

Owns: keeping weights for as long as a pulse counts in the ledger. Must not know: what a weight is
made of, clocks: time comes in.
"""

from __future__ import annotations

from collections.abc import Sequence


class ReturnWeights:
    """A weight counts for at least `window_ns` after a smaller one was set, and for twice that and
    the time between two calls at most. Before the first call all are 1.
    """

    def __init__(self, electrodes: int, window_ns: int) -> None:
        self._window_ns = window_ns
        self.of: Sequence[float] = [1.0] * electrodes
        #: The largest of all.
        self.most = 1.0
        self._current: Sequence[float] = self.of
        self._recent: Sequence[float] = self.of
        self._before: Sequence[float] = self.of
        self._since_ns = 0

    def set(self, weights: Sequence[float], now_ns: int) -> bool:
        """From now on these hold. Returns whether any weight that counts has risen."""
        if now_ns - self._since_ns >= self._window_ns:
            # The weights that were set last have held until now.
            self._before, self._recent, self._since_ns = self._recent, self._current, now_ns
        self._current = weights
        self._recent = list(map(max, self._recent, weights))
        counted, self.of = self.of, list(map(max, self._before, self._recent))
        self.most = max(self.of)
        return any(now > before for now, before in zip(self.of, counted, strict=True))
