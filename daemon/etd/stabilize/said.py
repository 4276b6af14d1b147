"""The factor on an electrode's current that follows from what the person says of it.

Owns: the rules below, for all electrodes (what one of them keeps: `said_electrode.py`). Must not
know: limits, laws, clocks, who says it: who may raise is decided by the caller. It is a request
like any other: the limits come after it.

- *too strong* lowers at once: every electrode, or those that are named. A single answer of the
  lease's holder about all takes less than any other, because of ten answers two may be errors.
  Repeated within half a minute it takes a fifth, and then half; within three minutes twice as much
  as the time before unless the holder said something else since. Repetition is counted for
  each electrode, and once more for all together: an answer about one electrode is no repetition of
  an answer about another.
- *too weak* and *good* let the factor rise to the estimate (`offset_estimate.py`): each by at most
  5 %, and all by at most 5 % in any minute. It rises at once; what the minute before leaves no room
  for follows when that is over, and within a minute of *too strong* there is no room: a program may
  say *good* all the time. Only what was lowered comes back so; where raising is allowed, *too weak*
  takes it above the frame's own, and never above 1.2.
- A fall within what is called good anyway (`BAND`) is given back by them, since no answer tells it
  from the frame's own strength; a deeper one only as far as the estimate rises; and one that has
  left hardly anything not at all.
- The same said of the same again within half a minute is one answer, but after *too strong*.
- *Good* may take from a rise above the frame's own, where less is expected by now; otherwise
  neither of the two lowers anything. It adds to it only of whom it was measured how fast use is
  felt less: *good* is to stay as it is felt, and makes up for what use has taken since the last
  word, of a minute at most; and after *too strong* for nothing, until *too weak*.
- Up only while the electrode is fired: not for one that was not fired in the last minute, whose
  rise above the frame's own is lost as well.
- Nothing rises by itself: without an answer a factor stays, or is lost by `reset`.

`lower` takes the word of a button or of a program without the lease: it only ever lowers, the
estimate too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from etd.stabilize.offset_estimate import Answer, OffsetEstimate
from etd.stabilize.said_electrode import (
    ANSWERED_LOWERED_BY,
    AT_ONCE_NS,
    LOWERED_BY,
    MOST_LOG,
    RISE_LOG,
    Insisting,
    SaidElectrode,
)

#: What an answer did, of the electrodes that it is about: it lowered some; it lets what was lowered
#: come back; it lets some rise above the frame's own strength; nothing.
Followed = Literal["lowered", "gives_back", "raises", "nothing"]


class FeltOffsets:
    """For all electrodes of an array; factors are 1 until somebody says something. `may_raise`:
    whether any may go above 1; otherwise what was lowered comes back, and no more.
    `fades_a_minute`: how much is felt less in a minute of use, where it was measured, as the
    logarithm of the factor that makes up for it.
    """

    def __init__(self, electrodes: int, *, may_raise: bool, fades_a_minute: float = 0.0) -> None:
        self._may_raise = may_raise
        self._fades_a_minute = fades_a_minute if may_raise else 0.0
        self._electrodes = [SaidElectrode() for _ in range(electrodes)]
        self._common = OffsetEstimate()
        self._insisting = Insisting()
        #: The last *good* or *too weak* that counted: of what, and when.
        self._word: tuple[Answer, frozenset[int] | None, int] | None = None
        #: Whether any factor can differ from 1.
        self.is_idle = True

    def reset(self) -> None:
        """All that was said is gone."""
        self._electrodes = [SaidElectrode() for _ in self._electrodes]
        self._common = OffsetEstimate()
        self._insisting = Insisting()
        self._word = None
        self.is_idle = True

    def fired(self, electrode: int, now_ns: int) -> None:
        """A pulse of a frame was fired at this electrode."""
        self._electrodes[electrode].fired(now_ns)

    def factor(self, electrode: int, now_ns: int) -> float:
        """On the current that is requested of a pulse now: at most `MOST`, and 1 where raising is
        not allowed, or nothing was fired at it in the last minute.
        """
        if self.is_idle:
            return 1.0
        found = self._electrodes[electrode]
        return math.exp(found.offset if found.was_felt(now_ns) else min(found.offset, 0.0))

    def left(self, electrode: int) -> float:
        """What *too strong* has left of a named current, as of its last pulse: at most 1."""
        return 1.0 if self.is_idle else math.exp(self._electrodes[electrode].left)

    def below(self, electrode: int) -> float:
        """The same of a level that answers may raise, of the frame's own: at most 1."""
        return 1.0 if self.is_idle else math.exp(min(self._electrodes[electrode].offset, 0.0))

    def last_factor(self, electrode: int) -> float:
        """As of its last pulse."""
        return math.exp(self._electrodes[electrode].offset)

    def factors(self) -> tuple[float, ...]:
        """The same of all electrodes."""
        return tuple([self.last_factor(electrode) for electrode in range(len(self._electrodes))])

    def was_felt(self, electrode: int, now_ns: int) -> bool:
        """Whether it was fired in the last minute."""
        return self._electrodes[electrode].was_felt(now_ns)

    def felt(self, now_ns: int) -> tuple[int, ...]:
        """The electrodes that were fired in the last minute."""
        return tuple(
            [
                number
                for number, electrode in enumerate(self._electrodes)
                if electrode.was_felt(now_ns)
            ]
        )

    def waits_ns(self, electrodes: Sequence[int] | None, now_ns: int) -> int | None:
        """How long until the first of these rises that the last word lets rise, where none rose at
        once; None: one did, or none will. Of those that were fired in the last minute.
        """
        waiting = []
        for each in [one for one in self._those(electrodes) if one.was_felt(now_ns)]:
            if each.room.was_taken(now_ns):
                return None
            if (waits_ns := each.waits_ns(now_ns)) is not None:
                waiting.append(waits_ns)
        return min(waiting, default=None)

    def hear(self, answer: Answer, electrodes: Sequence[int] | None, now_ns: int) -> Followed:
        """The word of the lease's holder: about these electrodes, or None: all in common. Of those
        it is about, only such as were fired in the last minute can rise.
        """
        if answer == "too_strong":
            first = ANSWERED_LOWERED_BY if electrodes is None else LOWERED_BY
            self._lower(electrodes, now_ns, first)
            return "lowered"
        self.is_idle = False
        if not self._is_said_again(answer, electrodes, now_ns):
            self._estimate(answer, electrodes, now_ns)
        for electrode in self._those(electrodes):
            electrode.insisting.contradict()
            if answer == "too_weak":
                electrode.use.is_made_up_for = True
        if electrodes is None:
            self._insisting.contradict()
        felt = [each for each in self._those(electrodes) if each.was_felt(now_ns)]
        is_lowered, rising = False, []
        for electrode in [each for each in felt if not each.is_hardly_anything]:
            before = electrode.offset
            target = electrode.let_go_to(
                self._wanted(electrode, now_ns),
                now_ns,
                is_weak=answer == "too_weak",
                most=self._most(electrode, answer),
            )
            is_lowered = is_lowered or electrode.offset < before
            if target > before:
                # One word lets it rise by no more than that.
                rising.append(min(target, before + RISE_LOG))
        if is_lowered:
            return "lowered"
        if not rising:
            return "nothing"
        return "raises" if max(rising) > 0.0 else "gives_back"

    def _is_said_again(self, answer: Answer, electrodes: Sequence[int] | None, now_ns: int) -> bool:
        """Within half a minute the same of the same is one answer, however often a program says
        it: the estimate takes each for another judgement of the person.
        """
        about = None if electrodes is None else frozenset(electrodes)
        if (
            self._word is not None
            and self._word[:2] == (answer, about)
            and now_ns - self._word[2] < AT_ONCE_NS
        ):
            return True
        self._word = answer, about, now_ns
        return False

    def lower(self, electrodes: Sequence[int] | None, now_ns: int) -> None:
        """*Too strong*, by a button or a program without the lease."""
        self._lower(electrodes, now_ns, LOWERED_BY)

    def _lower(self, electrodes: Sequence[int] | None, now_ns: int, first: float) -> None:
        self.is_idle = False
        # What is said after it is another answer, also where it was said before.
        self._word = None
        self._estimate("too_strong", electrodes, now_ns)
        if electrodes is None:
            step = -math.log(1.0 - self._insisting.takes(first, now_ns))
            for electrode in self._electrodes:
                electrode.lower_by(step, now_ns)
            return
        for electrode in self._those(electrodes):
            step = -math.log(1.0 - electrode.insisting.takes(first, now_ns))
            electrode.lower_by(step, now_ns)

    def _estimate(self, answer: Answer, electrodes: Sequence[int] | None, now_ns: int) -> None:
        """An answer about all is about their mean, beside what is known of each alone."""
        if electrodes is None:
            felt = [electrode for electrode in self._electrodes if electrode.was_felt(now_ns)]
            shared = [
                electrode.offset - electrode.own_mean(now_ns) - self._lost(electrode)
                for electrode in felt
            ]
            offset = sum(shared) / len(shared) if shared else 0.0
            self._common.hear(answer, offset, now_ns)
            return
        common, each_own, offsets = self._common.mean(now_ns), [], []
        for electrode in self._those(electrodes):
            own = electrode.own = electrode.own or OffsetEstimate()
            each_own.append(own)
            offsets.append(electrode.offset - common - self._lost(electrode))
        OffsetEstimate.hear_each(each_own, answer, offsets, now_ns)

    def _wanted(self, electrode: SaidElectrode, now_ns: int) -> float:
        """Estimates are of what is wanted beside what is expected to be lost."""
        said = self._common.mean(now_ns) + electrode.own_mean(now_ns)
        return said + self._lost(electrode)

    def _lost(self, electrode: SaidElectrode) -> float:
        return electrode.lost(self._fades_a_minute)

    def _most(self, electrode: SaidElectrode, answer: Answer) -> float:
        """Whatever is estimated: *good* is of the strength that there is, and keeps it."""
        if not self._may_raise:
            return 0.0
        return MOST_LOG if answer == "too_weak" else electrode.kept(self._fades_a_minute)

    def _those(self, electrodes: Sequence[int] | None) -> list[SaidElectrode]:
        if electrodes is None:
            return self._electrodes
        return [self._electrodes[number] for number in sorted(set(electrodes))]
