"""How fast current may rise: the array's opening, and each electrode's own after a re-contact.

Owns: one ceiling for the whole array, zero after arming, rising 0.5 mA per 100 ms while frames
stand; and the same ramp for an electrode that was open and is touched again.
Must not know: what the limits are, hardware, clocks: time comes in. A fall is never delayed.
"""

from __future__ import annotations

#: 0.5 mA per 100 ms, in steps that keep prepared pulses few.
STEP_UA = 50
STEP_NS = 10_000_000
#: Between two calls no more than this counts: neither a stall, nor scans in which a re-contacted
#: electrode was not visited, may show as a step of more than 0.5 mA.
LONGEST_STEP_NS = 100_000_000


class Ramp:
    """A ceiling that rises from zero while it is in use."""

    def __init__(self, top_ua: int) -> None:
        self._top_ua = top_ua
        self._counted_ns: int | None = None
        self.ceiling_ua = 0

    def restart(self) -> None:
        """Back to zero."""
        self.ceiling_ua = 0
        self._counted_ns = None

    def hold(self) -> None:
        """No frame stands: what is reached stays, but does not rise."""
        self._counted_ns = None

    def rise(self, now_ns: int) -> int:
        """In use: the ceiling in uA now."""
        if self.is_done:
            return self.ceiling_ua
        if self._counted_ns is None:
            self._counted_ns = now_ns
        self._counted_ns = max(self._counted_ns, now_ns - LONGEST_STEP_NS)
        steps = (now_ns - self._counted_ns) // STEP_NS
        self._counted_ns += steps * STEP_NS
        self.ceiling_ua = min(self._top_ua, self.ceiling_ua + steps * STEP_UA)
        return self.ceiling_ua

    @property
    def is_done(self) -> bool:
        return self.ceiling_ua >= self._top_ua


class Opening:
    """The array's ramp and those of single electrodes."""

    def __init__(self, top_ua: int) -> None:
        self._top_ua = top_ua
        self._array = Ramp(top_ua)
        self._recontacts: dict[int, Ramp] = {}

    @property
    def ceiling_ua(self) -> int:
        return self._array.ceiling_ua

    def restart(self) -> None:
        """After arming, a halt or a change of lease."""
        self._array.restart()
        self._recontacts.clear()

    def hold(self) -> None:
        """No frame stands."""
        self._array.hold()
        for ramp in self._recontacts.values():
            ramp.hold()

    def rise(self, now_ns: int) -> int:
        """A frame stands: the array's ceiling in uA now."""
        return self._array.rise(now_ns)

    def touched_again(self, electrode: int) -> None:
        """An open electrode is touched: from zero, for it alone."""
        self._recontacts[electrode] = Ramp(self._top_ua)

    def recontact_ua(self, electrode: int, now_ns: int) -> int | None:
        """The electrode's own ceiling, or None where it has none."""
        ramp = self._recontacts.get(electrode)
        if ramp is None:
            return None
        ceiling_ua = ramp.rise(now_ns)
        if ramp.is_done:
            del self._recontacts[electrode]
        return ceiling_ua
