"""A frame of a pattern that was sent: from when on it counts as shown, by telemetry.

Owns: what counts as the start, and how long the soft start holds it. Must not know: sockets, how
frames are sent and renewed. Time is passed in.

A frame counts as shown from the start of its first scan. One that is stronger than all before it
raises the soft start's ceiling pulse by pulse, and counts as shown once it is not clamped any more.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.client.steps import Step
from etd.protocol.errors import Refused
from etd.protocol.messages import Scan, Shown

_MS = 1_000_000
#: The ceiling rises with every pulse, and patterns have at least one pulse a second.
_RISES_WITHIN_NS = 15_000 * _MS
#: A soft start that clamps a frame does so in its first scan. A report shows that once a pulse was
#: fired, or after this time.
_FIRST_SCAN_NS, _FIRST_PULSE_NS = 500 * _MS, 100 * _MS
#: One report may end in the middle of a scan, before the strongest pulse.
_CLEAR_REPORTS = 2


@dataclass(slots=True)
class Standing:
    """A step that has been sent, once or more. Times are the client's, `begun_ns` the engine's."""

    step: Step
    seqs: set[int]
    sent_ns: int
    expires_ns: int
    begun_ns: int | None = None
    #: The soft start clamps it. Once it does not, the frame is not held again.
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
        """When its duration ends, on the engine's clock."""
        return None if self.begun_ns is None else self.begun_ns + self.step.duration_ms * _MS

    def hear(self, scan: Scan, now_ns: int) -> None:
        """Process a report. Raises: Refused, if it is held and the ceiling does not rise."""
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
        elif self._is_decided(scan, mine[0], begun_ns):
            self.begun_ns = begun_ns

    def _is_decided(self, scan: Scan, shown: Shown, begun_ns: int) -> bool:
        """Whether a report is late enough to show a clamp by the soft start."""
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
                f"the soft start's ceiling stays at {scan.ceiling_ua} uA, below the"
                f" {self.step.largest_ua} uA of frame {self.step.options.get('tag')}",
            )
