"""How fast current may rise: the array's soft start, and each electrode's own after a re-contact.

Owns: one ceiling for the whole array, zero at the beginning of a person's session, which rises
through the pulses that are fired at it; the same ramp for an electrode that was open and is touched
again; and how long both stand without a pulse.
Must not know: what the limits are, what ends a session, hardware, clocks: time comes in. A fall is
never delayed.

Only fired pulses raise a ceiling: a standing frame and passing time do not. Two bounds hold for
every pulse, and the lower bound is its ceiling:

    0.5 mA above the highest current that was fired 100 ms ago or longer
    50 uA for every 10 ms above the highest current that was let through to any pulse before it,
        counted from the last pulse that was fired at its ceiling

By the first, no pulse within any 100 ms exceeds by more than 0.5 mA what was fired before them. By
the second, the ceiling rises in small steps wherever pulses are close enough.

What was fired stands for a minute without a pulse, also while the supply is off. Then the person
may have forgotten how it feels, and the contact may be another one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from etd.protocol.carried import RampState, SoftStartState

#: 0.5 mA per 100 ms, in steps that keep prepared pulses few.
STEP_UA = 50
STEP_NS = 10_000_000
RISE_UA = 500
WINDOW_NS = 100_000_000
#: Without a pulse for so long a ramp begins anew.
FORGOTTEN_NS = 60_000_000_000
#: Where a rise takes longer, its end is not foretold.
_FORETOLD_NS = 60_000_000_000
#: What is foretold of a pulse: it ends so long after it is due, and the source makes less of it.
_PULSE_NS, _LESS_UA = 300_000, 3


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
        #: When the last pulse ended, or the first was due.
        self._last_ns = 0
        self.ceiling_ua = 0

    def due(self, now_ns: int) -> int:
        """The ceiling in uA of a pulse that is due now; `ceiling_ua` keeps it."""
        if now_ns - self._last_ns >= FORGOTTEN_NS:
            self.restart()
        if self._counted_ns is None:
            self._counted_ns = self._last_ns = now_ns
        rises, settled_ns = self._rises, now_ns - WINDOW_NS
        while rises and rises[0][0] <= settled_ns:
            self._settled_ua = rises.popleft()[1]
        steps = (now_ns - self._counted_ns) // STEP_NS
        ceiling_ua, settled_ua = self._reached_ua + steps * STEP_UA, self._settled_ua + RISE_UA
        if settled_ua < ceiling_ua:
            ceiling_ua = settled_ua
        if self._top_ua < ceiling_ua:
            ceiling_ua = self._top_ua
        self._due_ns, self.ceiling_ua = now_ns, ceiling_ua
        return ceiling_ua

    def fired(self, given_ua: int, commanded_ua: int, ended_ns: int) -> None:
        """The pulse that was due was fired: the limits let `given_ua` through, the source was
        commanded to `commanded_ua`, which is no more, and the message ended at `ended_ns`.
        """
        counted_ns = self._counted_ns
        if counted_ns is None:
            return  # It was due before the restart, and raises nothing after it.
        self._last_ns = ended_ns
        if commanded_ua > self._fired_ua:
            self._fired_ua = commanded_ua
            self._rises.append((ended_ns, commanded_ua))
        if given_ua > self._reached_ua or given_ua >= self.ceiling_ua:
            self._reached_ua = max(self._reached_ua, given_ua)
            # Whole steps are used up; the rest of a step counts for the next pulse.
            passed_ns = self._due_ns - counted_ns
            left_ns = passed_ns % STEP_NS if passed_ns < WINDOW_NS else 0
            self._counted_ns = self._due_ns - left_ns

    def copy(self) -> Ramp:
        """One that pulses can be tried on."""
        ramp = Ramp(self._top_ua)
        ramp._reached_ua, ramp._fired_ua = self._reached_ua, self._fired_ua
        ramp._settled_ua, ramp._rises = self._settled_ua, deque(self._rises)
        ramp._counted_ns, ramp._due_ns = self._counted_ns, self._due_ns
        ramp._last_ns, ramp.ceiling_ua = self._last_ns, self.ceiling_ua
        return ramp

    def saved(self) -> RampState:
        """For a record."""
        return RampState(
            reached_ua=self._reached_ua,
            fired_ua=self._fired_ua,
            settled_ua=self._settled_ua,
            rises=tuple(self._rises),
            counted_ns=self._counted_ns,
            due_ns=self._due_ns,
            last_ns=self._last_ns,
            ceiling_ua=self.ceiling_ua,
        )

    def resume(self, state: RampState, ahead_ns: int) -> None:
        """As a record has it, whose clock is so much ahead of the one here."""
        self._reached_ua, self._fired_ua = state.reached_ua, state.fired_ua
        self._settled_ua, self.ceiling_ua = state.settled_ua, state.ceiling_ua
        self._rises = deque((t_ns - ahead_ns, current_ua) for t_ns, current_ua in state.rises)
        self._counted_ns = None if state.counted_ns is None else state.counted_ns - ahead_ns
        self._due_ns, self._last_ns = state.due_ns - ahead_ns, state.last_ns - ahead_ns

    def risen_after_ns(self, current_ua: int, period_ns: int, now_ns: int) -> int | None:
        """In how long a pulse of `current_ua` that is due each period would be let through, if they
        begin now; None where it would not within a minute.
        """
        ramp, due_ns = self.copy(), now_ns
        while due_ns - now_ns <= _FORETOLD_NS:
            ceiling_ua = ramp.due(due_ns)
            if ceiling_ua >= current_ua:
                return due_ns - now_ns
            ramp.fired(ceiling_ua, max(0, ceiling_ua - _LESS_UA), due_ns + _PULSE_NS)
            due_ns += period_ns
        return None


class SoftStart:
    """The ramp of the array, and those of re-contacted electrodes."""

    def __init__(self, top_ua: int) -> None:
        self._top_ua = top_ua
        self._array = Ramp(top_ua)
        self._recontacts: dict[int, Ramp] = {}
        #: Known to be open when the supply went off.
        self._were_open: set[int] = set()

    @property
    def ceiling_ua(self) -> int:
        """The array's ceiling for the last pulse that was due; 0 before the first."""
        return self._array.ceiling_ua

    def restart(self) -> None:
        """Called when a session begins, and with each silence but the end of a lease."""
        self._array.restart()
        self._recontacts.clear()
        self._were_open.clear()

    def saved(self) -> SoftStartState:
        """For a record."""
        return SoftStartState(
            array=self._array.saved(),
            recontacts={electrode: ramp.saved() for electrode, ramp in self._recontacts.items()},
            were_open=tuple(sorted(self._were_open)),
        )

    def resume(self, state: SoftStartState, ahead_ns: int) -> None:
        """Stand as in a record that is replayed, whose clock is so much ahead. Nothing but a replay
        calls this: a board with a person at it begins at zero.
        """
        self.restart()
        self._array.resume(state.array, ahead_ns)
        for electrode, ramp_state in state.recontacts.items():
            self.touched_again(electrode)
            self._recontacts[electrode].resume(ramp_state, ahead_ns)
        self._were_open.update(state.were_open)

    def due(self, now_ns: int) -> int:
        """The array's ceiling in uA for a pulse that is due now."""
        return self._array.due(now_ns)

    def ceilings(self, now_ns: int) -> tuple[int, dict[int, int]]:
        """The array's ceiling in uA and those of re-contacted electrodes, for pulses that would be
        due now. Nothing changes.
        """
        own_ua = {
            electrode: ramp.copy().due(now_ns) for electrode, ramp in self._recontacts.items()
        }
        return self._array.copy().due(now_ns), own_ua

    def risen_after_ns(
        self, electrode: int, current_ua: int, period_ns: int, now_ns: int
    ) -> int | None:
        """In how long a pulse of `current_ua` would be let through, if the electrode is pulsed each
        period from now on; None where it would not within a minute.
        """
        array_ns = self._array.risen_after_ns(current_ua, period_ns, now_ns)
        ramp = self._recontacts.get(electrode)
        if ramp is None or array_ns is None:
            return array_ns
        own_ns = ramp.risen_after_ns(current_ua, period_ns, now_ns)
        return None if own_ns is None else max(array_ns, own_ns)

    def touched_again(self, electrode: int) -> None:
        """An open electrode is touched again: its own ramp begins at zero and holds until the soft
        start restarts.
        """
        self._recontacts[electrode] = Ramp(self._top_ua)

    def supply_off(self, are_touched: Sequence[bool | None], is_lowered: bool = False) -> None:
        """All contacts are unknown from now on, and the ceilings stand; unless the person's word
        `is_lowered` them: it is forgotten with the supply, and nothing must come back at once.
        """
        if is_lowered:
            self.restart()
        for electrode, is_touched in enumerate(are_touched):
            if is_touched is False:
                self._were_open.add(electrode)

    def found(self, electrode: int, *, is_touched: bool) -> None:
        """What the probe of the power-up has found of an electrode."""
        if is_touched and electrode in self._were_open:
            self._were_open.discard(electrode)
            self.touched_again(electrode)

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
