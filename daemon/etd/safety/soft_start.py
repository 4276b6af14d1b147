"""How fast current may rise: the array's soft start, and each electrode's own after a re-contact.

Owns: one ceiling for the whole array, zero after arming, which rises through the pulses that are
fired at it; and the same ramp for an electrode that was open and is touched again.
Must not know: what the limits are, hardware, clocks: time comes in. A fall is never delayed.

Only fired pulses raise a ceiling: a standing frame and passing time do not. Two bounds hold for
every pulse, and the lower bound is its ceiling:

    0.5 mA above the highest current that was fired 100 ms ago or longer
    50 uA for every 10 ms above the highest current that was let through to any pulse before it,
        counted from the last pulse that was fired at its ceiling, and for 100 ms at most

By the first, no pulse within any 100 ms exceeds by more than 0.5 mA what was fired before them. By
the second, the ceiling rises in small steps wherever pulses are close enough.
"""

from __future__ import annotations

from collections import deque

#: 0.5 mA per 100 ms, in steps that keep prepared pulses few.
STEP_UA = 50
STEP_NS = 10_000_000
RISE_UA = 500
WINDOW_NS = 100_000_000


class Ramp:
    """A ceiling that rises from zero with the pulses fired at it."""

    def __init__(self, top_ua: int) -> None:
        self._top_ua = top_ua
        self.restart()

    def restart(self) -> None:
        """Back to zero."""
        #: The highest current let through to a fired pulse; the source has steps, so less was
        #: fired.
        self._reached_ua = 0
        #: The highest current fired, and the highest fired before the window.
        self._fired_ua = 0
        self._settled_ua = 0
        #: Within the window: when a current higher than all before was fired, and how much.
        self._rises: deque[tuple[int, int]] = deque()
        #: Time counts from here; None until a pulse is due.
        self._counted_ns: int | None = None
        self._due_ns = 0
        self.ceiling_ua = 0

    def due(self, now_ns: int) -> int:
        """The ceiling in uA of a pulse that is due now; `ceiling_ua` keeps it."""
        if self._counted_ns is None:
            self._counted_ns = now_ns
        rises, settled_ns = self._rises, now_ns - WINDOW_NS
        while rises and rises[0][0] <= settled_ns:
            self._settled_ua = rises.popleft()[1]
        passed_ns = now_ns - self._counted_ns
        steps = (passed_ns if passed_ns < WINDOW_NS else WINDOW_NS) // STEP_NS
        ceiling_ua, settled_ua = self._reached_ua + steps * STEP_UA, self._settled_ua + RISE_UA
        if settled_ua < ceiling_ua:
            ceiling_ua = settled_ua
        if self._top_ua < ceiling_ua:
            ceiling_ua = self._top_ua
        self._due_ns, self.ceiling_ua = now_ns, ceiling_ua
        return ceiling_ua

    def fired(self, given_ua: int, commanded_ua: int, ended_ns: int) -> None:
        """The pulse that was due was fired: the limits let `given_ua` through, the source was
        commanded to `commanded_ua`, and the message ended at `ended_ns`.
        """
        if commanded_ua > self._fired_ua:
            self._fired_ua = commanded_ua
            self._rises.append((ended_ns, commanded_ua))
        if given_ua > self._reached_ua or given_ua >= self.ceiling_ua:
            self._reached_ua = max(self._reached_ua, given_ua)
            self._use_time()

    def _use_time(self) -> None:
        """Whole steps are used up; the rest of a step counts for the next pulse."""
        passed_ns = self._due_ns - (self._counted_ns or 0)
        left_ns = passed_ns % STEP_NS if passed_ns < WINDOW_NS else 0
        self._counted_ns = self._due_ns - left_ns


class SoftStart:
    """The ramp of the array, and those of re-contacted electrodes."""

    def __init__(self, top_ua: int) -> None:
        self._top_ua = top_ua
        self._array = Ramp(top_ua)
        self._recontacts: dict[int, Ramp] = {}

    @property
    def ceiling_ua(self) -> int:
        """The array's ceiling for the last pulse that was due; 0 before the first."""
        return self._array.ceiling_ua

    def restart(self) -> None:
        """Called with every silence (the end of a lease is one), and once armed, since the probes
        of the power-up were fired like a frame's pulses.
        """
        self._array.restart()
        self._recontacts.clear()

    def due(self, now_ns: int) -> int:
        """The array's ceiling in uA for a pulse that is due now."""
        return self._array.due(now_ns)

    def touched_again(self, electrode: int) -> None:
        """An open electrode is touched again: its own ramp begins at zero and holds until the soft
        start restarts.
        """
        self._recontacts[electrode] = Ramp(self._top_ua)

    def recontact_ua(self, electrode: int, now_ns: int) -> int | None:
        """The electrode's own ceiling in uA for a pulse that is due now; None where it has none."""
        ramp = self._recontacts.get(electrode)
        return None if ramp is None else ramp.due(now_ns)

    def fired(self, electrode: int, given_ua: int, commanded_ua: int, ended_ns: int) -> None:
        """A frame's pulse was fired. Probes and contact polls do not count: they are weak and
        short, and show nothing of what a person is used to.
        """
        self._array.fired(given_ua, commanded_ua, ended_ns)
        ramp = self._recontacts.get(electrode)
        if ramp is not None:
            ramp.fired(given_ua, commanded_ua, ended_ns)
