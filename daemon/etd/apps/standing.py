"""A frame of a pattern that was sent: since when it counts as shown, as telemetry tells it.

Owns: what counts as the beginning, and how long the opening holds it. Must not know: sockets, how
frames are sent and renewed. Time comes in.

A frame counts as shown from the start of its first scan. One that is stronger than all before it
raises the opening, pulse by pulse, and counts as shown from when nothing is taken of it any more.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.apps.steps import Step
from etd.protocol.errors import Refused
from etd.protocol.messages import Scan, Shown

_MS = 1_000_000
#: The opening rises with every pulse, and one a second there is at least in what is played.
_RISES_WITHIN_NS = 15_000 * _MS
#: An opening that takes something of a frame does so in its first scan. Until a pulse of it was
#: fired, or for so long at most, a report does not tell.
_FIRST_SCAN_NS, _FIRST_PULSE_NS = 500 * _MS, 100 * _MS
#: One report may end in the middle of a scan, before the strongest pulse.
_CLEAR_REPORTS = 2


@dataclass(slots=True)
class Standing:
    """A step that has been sent, once or more. Times of the client's clock, but `begun_ns`."""

    step: Step
    seqs: set[int]
    sent_ns: int
    expires_ns: int
    begun_ns: int | None = None
    #: The opening takes something of it. Once it does not, it is not held again.
    is_held: bool = False
    held_ms: float = 0.0
    _was_held: bool = False
    _first_sent_ns: int = 0
    _clear: int = 0
    _fired_ns: int = 0
    _ceiling_ua: int = 0
    _risen_ns: int = 0

    def __post_init__(self) -> None:
        self._first_sent_ns = self.sent_ns

    @property
    def due_ns(self) -> int | None:
        """When it has had its time, on the engine's clock."""
        return None if self.begun_ns is None else self.begun_ns + self.step.duration_ms * _MS

    def hear(self, scan: Scan, now_ns: int) -> None:
        """What a report says of it, if anything. Raises: Refused, where it is held and the opening
        does not rise.
        """
        mine = [shown for shown in scan.shown if shown.seq in self.seqs]
        if not mine:
            return
        is_clamped = any(clamp.reason == "soft_start" for clamp in scan.clamped)
        begun_ns = mine[0].begun_ns if self.begun_ns is None else self.begun_ns
        if is_clamped and not self._was_held and scan.now_ns - begun_ns < _FIRST_SCAN_NS:
            self.is_held = self._was_held = True
            self._risen_ns, self.begun_ns = now_ns, None
        if self.is_held:
            self._check_rise(scan, now_ns)
            self._look_for_release(scan, mine[-1], is_clamped, now_ns)
        elif self._is_told(scan, mine[0], begun_ns):
            self.begun_ns = begun_ns

    def _is_told(self, scan: Scan, shown: Shown, begun_ns: int) -> bool:
        """Whether a report is late enough to tell whether the opening takes something."""
        if shown.first_ns is not None or not self.step.largest_ua:
            return True
        return scan.now_ns - begun_ns >= _FIRST_PULSE_NS

    def _look_for_release(self, scan: Scan, shown: Shown, is_clamped: bool, now_ns: int) -> None:
        fired_ns = shown.last_ns or 0
        if is_clamped:
            self._clear = 0
        elif fired_ns > self._fired_ns:
            self._clear += 1
        self._fired_ns = fired_ns
        is_wide = scan.ceiling_ua >= self.step.largest_ua and not is_clamped
        if is_wide or self._clear >= _CLEAR_REPORTS:
            self.is_held, self.begun_ns = False, scan.now_ns
            self.held_ms = (now_ns - self._first_sent_ns) / _MS

    def _check_rise(self, scan: Scan, now_ns: int) -> None:
        if scan.ceiling_ua > self._ceiling_ua:
            self._ceiling_ua, self._risen_ns = scan.ceiling_ua, now_ns
        elif now_ns - self._risen_ns > _RISES_WITHIN_NS:
            raise Refused(
                "wrong_state",
                f"the opening stays at {scan.ceiling_ua} uA, and frame"
                f" {self.step.options.get('tag')} asks for {self.step.largest_ua} uA",
            )
