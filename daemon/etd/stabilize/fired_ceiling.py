"""The most that electrodes get after *too strong* was said where more was asked for than fired.

Owns: what each electrode has been fired lately, these ceilings, in uA, and how they rise. Must not
know: who says what, which limit it was but that a soft start goes on, clocks.

`said.py` takes its part of what a frame asks. Where a soft start, a cap or a return has left less
than that, such a part takes nothing of what is felt, and a soft start goes on to rise. So then the
part is taken of the strongest pulse that was fired lately (`Lately`), and nothing passes it:

- at each electrode that the word is about, of its own pulses, however long ago they were;
- after a word about all, of the strongest of all of them where the soft start of the array left
  less, at every electrode, also one that was not fired yet.

A word takes its part of a ceiling that there is as well. *Good* gives back what was taken, *too
weak* lets it rise beyond, both by 5 % in any minute, not within a minute of *too strong*, and only
where it bound a pulse of the last minute: they are said of what is felt.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from etd.stabilize.said_electrode import (
    FELT_NS,
    HARDLY_ANYTHING,
    LEAST_LOG,
    LETS_RISE_NS,
    RISE_LOG,
    RiseRoom,
)

#: A word is about the pulses of so long, and up to twice as long: who presses does so within one
#: or two seconds, who is asked within a few.
LATELY_NS: Final = 5_000_000_000
#: No word takes more than to here, of which nothing is fired: it is still a number to divide by.
_FLOOR_UA: Final = 0.1
#: Fired and asked for.
_NOTHING: Final = (0, 0)


class Lately:
    """The strongest current fired and the strongest asked for, of the last seconds with pulses."""

    __slots__ = ("_before", "_begun_ns", "_now", "fired_ns")

    def __init__(self) -> None:
        #: Fired and asked for: since `_begun_ns`, and in as long before.
        self._now = self._before = _NOTHING
        self._begun_ns = 0
        self.fired_ns: int | None = None

    def fired(self, fired_ua: int, wanted_ua: int, now_ns: int, *, by_ramp: bool) -> None:
        """`by_ramp`: a soft start lowered it. If something stronger was fired before, it has begun
        anew, and will rise from here.
        """
        since_ns = now_ns - self._begun_ns
        if since_ns >= LATELY_NS:
            self._before = self._now if since_ns < 2 * LATELY_NS else _NOTHING
            self._now, self._begun_ns = _NOTHING, now_ns
        if by_ramp and fired_ua < self.most_ua:
            self._now = self._before = _NOTHING
        most_ua, asked_ua = self._now
        self._now = max(fired_ua, most_ua), max(wanted_ua, asked_ua)
        self.fired_ns = now_ns

    @property
    def most_ua(self) -> int:
        return max(self._now[0], self._before[0])

    @property
    def is_limited(self) -> bool:
        """Whether more was asked for than was fired."""
        return max(self._now[1], self._before[1]) > self.most_ua


class FiredCeiling:
    """`most_ua`: what is left. `too_strong_ua`: what the last word was said of."""

    __slots__ = (
        "_bound_ns",
        "_first_ua",
        "_goal_ua",
        "_room",
        "_until_ns",
        "most_ua",
        "too_strong_ua",
    )

    def __init__(self, fired_ua: float, fired_ns: int | None, left: float, now_ns: int) -> None:
        """Of a pulse that was fired then; None: not at this electrode."""
        self.most_ua = self._first_ua = max(fired_ua, _FLOOR_UA)
        self._until_ns, self._bound_ns, self._room = now_ns, fired_ns, RiseRoom()
        self.lower(fired_ua, left, now_ns)

    def lower(self, fired_ua: float, left: float, now_ns: int) -> None:
        """Of what was fired, this part is left; and what an earlier word lets rise does not."""
        self.too_strong_ua = max(min(fired_ua, self.most_ua), _FLOOR_UA)
        self.most_ua = self._goal_ua = max(self.too_strong_ua * left, _FLOOR_UA)
        self._room.fill(now_ns)

    @property
    def left(self) -> float:
        """Of what it was first made of; it does not rise where that is hardly anything."""
        return self.most_ua / self._first_ua

    def binds(self, now_ns: int) -> bool:
        """Whether a pulse of the last minute was fired at it, and it can rise."""
        if self._bound_ns is None or self.left < HARDLY_ANYTHING:
            return False
        return now_ns - self._bound_ns <= FELT_NS

    def let_rise(self, now_ns: int, *, is_weak: bool) -> bool:
        """By the next word, once. False: it does not rise by that."""
        if not self.binds(now_ns):
            return False
        by_word_ua = self.most_ua * math.exp(RISE_LOG)
        self._goal_ua = by_word_ua if is_weak else min(by_word_ua, self.too_strong_ua)
        self._until_ns = now_ns + LETS_RISE_NS
        wanted = math.log(self._goal_ua / self.most_ua)
        self._rise(now_ns)
        return wanted > LEAST_LOG

    def waits_ns(self, now_ns: int) -> int | None:
        """Until there is room for what the last word lets it rise; None: it rises no more."""
        if now_ns >= self._until_ns or not self.binds(now_ns):
            return None
        if math.log(self._goal_ua / self.most_ua) <= LEAST_LOG:
            return None
        return self._room.waits_ns(now_ns)

    def fired(self, fired_ua: int, now_ns: int) -> None:
        """A pulse: rises with it as far as there is room by now, if it bound one in the minute
        before; or loses its rise.
        """
        is_bound = fired_ua >= int(self.most_ua)
        if self.binds(now_ns):
            self._rise(now_ns)
        else:
            self._goal_ua = self.most_ua
        if is_bound:
            self._bound_ns = now_ns

    def _rise(self, now_ns: int) -> None:
        if now_ns < self._until_ns:
            wanted = math.log(self._goal_ua / self.most_ua)
            self.most_ua *= math.exp(self._room.take(wanted, now_ns))


class FiredCeilings:
    """Of all electrodes."""

    def __init__(self, electrodes: int) -> None:
        self._lately = [Lately() for _ in range(electrodes)]
        #: Of all electrodes together, and what the array's soft start left of it.
        self._array = Lately()
        self._ceilings: dict[int, FiredCeiling] = {}

    def __bool__(self) -> bool:
        return bool(self._ceilings)

    def fired(
        self,
        electrode: int,
        fired_ua: int,
        wanted_ua: int,
        now_ns: int,
        *,
        by_array: bool,
        by_own: bool,
    ) -> None:
        """A pulse of a frame, of which so much was asked for. `by_array`, `by_own`: the array's
        soft start had lowered it, or the electrode's own.
        """
        self._lately[electrode].fired(fired_ua, wanted_ua, now_ns, by_ramp=by_array or by_own)
        asked_ua = wanted_ua if by_array else fired_ua
        self._array.fired(fired_ua, asked_ua, now_ns, by_ramp=by_array)
        if (ceiling := self._ceilings.get(electrode)) is not None:
            ceiling.fired(fired_ua, now_ns)

    def was_fired(self, electrode: int) -> bool:
        return self._lately[electrode].fired_ns is not None

    def is_limited(self, electrode: int) -> bool:
        """Whether more was asked for lately than was fired."""
        return self._lately[electrode].is_limited

    def most_ua(self, electrode: int) -> float:
        """Infinite where no word bounds it."""
        ceiling = self._ceilings.get(electrode)
        return math.inf if ceiling is None else ceiling.most_ua

    def left(self, electrode: int) -> float:
        """Of what was first too strong, or more; 1 where nothing was."""
        ceiling = self._ceilings.get(electrode)
        return 1.0 if ceiling is None else ceiling.left

    def lower(self, left: Mapping[int, float], now_ns: int, *, are_all: bool) -> None:
        """*Too strong* of these electrodes, of which it has left such parts."""
        array_ua = self._array.most_ua if are_all and self._array.is_limited else None
        for electrode, part in left.items():
            lately, ceiling = self._lately[electrode], self._ceilings.get(electrode)
            of_ua = lately.most_ua if lately.is_limited else array_ua
            if ceiling is not None:
                ceiling.lower(ceiling.most_ua if of_ua is None else of_ua, part, now_ns)
            elif of_ua is not None:
                fired_ns = lately.fired_ns if lately.is_limited else None
                self._ceilings[electrode] = FiredCeiling(of_ua, fired_ns, part, now_ns)

    def let_rise(self, electrodes: Sequence[int], now_ns: int, *, is_weak: bool) -> bool:
        """*Good* or *too weak* of these. Whether any does."""
        ceilings = [self._ceilings[one] for one in electrodes if one in self._ceilings]
        rising = [ceiling.let_rise(now_ns, is_weak=is_weak) for ceiling in ceilings]
        return any(rising)

    def waits_ns(self, electrodes: Sequence[int], now_ns: int) -> int | None:
        """How long until the first of these rises; None: one did with the last word, or none."""
        waits = [
            self._ceilings[one].waits_ns(now_ns) for one in electrodes if one in self._ceilings
        ]
        return min([wait for wait in waits if wait is not None], default=None)

    def binding_ua(self, electrodes: Sequence[int], now_ns: int) -> dict[int, float]:
        """Of these, those that bound a pulse of the last minute, by electrode."""
        each = [(one, self._ceilings[one]) for one in electrodes if one in self._ceilings]
        return {electrode: ceiling.most_ua for electrode, ceiling in each if ceiling.binds(now_ns)}
