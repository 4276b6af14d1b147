"""The heartbeat's edges while a board is tested.

Owns: when an edge is due, and the longest gap between edges: a supply that fell in such a gap
proves no guard. Must not know: waiting, what is measured meanwhile.
"""

from __future__ import annotations

from etd_hal.board import Board
from etd_hal.ports import Clock

_NS_PER_MS = 1_000_000
#: Edges come this often within the monostable's window.
_BEATS_PER_WINDOW = 4


class Beats:
    """On a board without a heartbeat no edge is ever due, or missed."""

    def __init__(self, board: Board, clock: Clock) -> None:
        self._board = board
        self._clock = clock
        heartbeat = board.file.guards.heartbeat
        self._window_ns = None if heartbeat == "absent" else heartbeat.window_ms * _NS_PER_MS
        #: Continue without the supply, so that the heartbeat is not what switched it off.
        self.go_on_when_off = False
        #: The time of the last edge.
        self.last_ns = 0
        self._longest_gap_ns = 0

    @property
    def every_ms(self) -> float | None:
        """Between two edges; None without a heartbeat."""
        if self._window_ns is None:
            return None
        return self._window_ns / _BEATS_PER_WINDOW / _NS_PER_MS

    def beat_if_due(self) -> None:
        """One edge, if it is time for one."""
        is_wanted = self._board.is_supply_on or self.go_on_when_off
        if self._window_ns is None or not is_wanted:
            return
        if self._clock.now_ns() - self.last_ns >= self._window_ns // _BEATS_PER_WINDOW:
            self.beat()

    def beat(self) -> None:
        """One edge, whether or not the supply is on."""
        now_ns = self._clock.now_ns()
        self._longest_gap_ns = max(self._longest_gap_ns, now_ns - self.last_ns)
        self.last_ns = now_ns
        self._board.beat()

    def begin(self) -> None:
        """Restart the measurement of gaps, with an edge."""
        self.last_ns = self._clock.now_ns()
        self._longest_gap_ns = 0
        self._board.beat()

    def missed_ms(self) -> float | None:
        """The longest gap since `begin`, if the gate may have acted in it; otherwise None."""
        if self._window_ns is None:
            return None
        gap_ns = max(self._longest_gap_ns, self._clock.now_ns() - self.last_ns)
        return gap_ns / _NS_PER_MS if gap_ns > self._window_ns else None
