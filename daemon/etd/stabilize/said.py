"""The factor on an electrode's current that follows from what the person says of it.

Owns: the rules below, electrode by electrode. Must not know: limits, laws, clocks, who says it: who
may raise is decided by the caller. It is a request like any other: the limits come after it.

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
  from the frame's own strength; a deeper one only as far as the estimate rises.
- The same said of the same again within half a minute is one answer, but after *too strong*.
- *Good* may take from a rise above the frame's own, where less is expected by now, and never adds
  to it; otherwise neither of the two lowers anything.
- Up only while the electrode is fired: not for one that was not fired in the last minute, whose
  rise above the frame's own is lost as well.
- Nothing rises by itself: without an answer a factor stays, or is lost by `reset`.

`lower` takes the word of a button or of a program without the lease: it only ever lowers, the
estimate too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

from etd.stabilize.offset_estimate import BAND, Answer, OffsetEstimate

#: What an answer is about: pulses of the last minute.
FELT_NS: Final = 60_000_000_000
#: The most that a factor reaches, and by how much it rises in any minute. A step of that is less
#: than half of what is called good anyway (`BAND`).
MOST: Final = 1.2
RISE_A_MINUTE: Final = 1.05
MINUTE_NS: Final = 60_000_000_000
#: A word lets it rise for so long: room comes within a minute, and with a pulse after that.
LETS_RISE_NS: Final = 90_000_000_000
#: What *too strong* takes at once: of named electrodes, or without the lease; and as an answer of
#: the holder about all. So many times as much as the time before it takes where it is said again
#: within minutes, and where it is said again at once (as much as after a first one that takes 5 %
#: at least); the most.
LOWERED_BY: Final = 0.05
ANSWERED_LOWERED_BY: Final = 0.02
AGAIN_TIMES: Final = 2.0
AGAIN_NS: Final = 180_000_000_000
AT_ONCE_TIMES: Final = 4.0
AT_ONCE_NS: Final = 30_000_000_000
MOST_LOWERED_BY: Final = 0.5
_MOST_LOG: Final = math.log(MOST)
_RISE_LOG: Final = math.log(RISE_A_MINUTE)
#: Less than this is no rise but rounding.
_LEAST_LOG: Final = 1e-9

#: What an answer did, of the electrodes that it is about: it lowered some; it lets what was lowered
#: come back; it lets some rise above the frame's own strength; nothing.
Followed = Literal["lowered", "gives_back", "raises", "nothing"]


class _Insisting:
    """The last *too strong* about the same: when it was said, what it took, and until when it is
    insisted on by saying it again.
    """

    __slots__ = ("_last",)

    def __init__(self) -> None:
        self._last: tuple[int, float, int] | None = None

    def takes(self, first: float, now_ns: int) -> float:
        """The part of the current that one takes now: `first`, or more."""
        took = min(max(first, self._insisted(now_ns)), MOST_LOWERED_BY)
        self._last = now_ns, took, now_ns + AGAIN_NS
        return took

    def _insisted(self, now_ns: int) -> float:
        """What it takes because it is said again. At once it is no error any more."""
        if self._last is None:
            return 0.0
        said_ns, took, until_ns = self._last
        if now_ns - said_ns <= AT_ONCE_NS:
            return AT_ONCE_TIMES * max(took, LOWERED_BY)
        return AGAIN_TIMES * took if now_ns <= until_ns else 0.0

    def contradict(self) -> None:
        """*Good* or *too weak*: the next *too strong* is a first one, unless it comes at once, as
        that of a wearer who presses while a program says something else.
        """
        if self._last is not None:
            said_ns, took, _ = self._last
            self._last = said_ns, took, said_ns


class _Rise:
    """What the last word lets an electrode rise: to the offset `target`, by `left` at most, before
    `until_ns`.
    """

    __slots__ = ("left", "target", "until_ns")

    def __init__(self, target: float, now_ns: int) -> None:
        self.target: Final = target
        self.until_ns: Final = now_ns + LETS_RISE_NS
        self.left = _RISE_LOG

    def by(self, offset: float) -> float:
        """From there."""
        return min(self.target - offset, self.left)


class _Electrode:
    """`offset`: the logarithm of its factor; `left`: the same of a current that is named, which
    nothing raises above itself, so that *too strong* takes from that and not from a rise; `rises`:
    what took of the room of the last minute, when, and how much.
    """

    __slots__ = ("fired_ns", "insisting", "left", "offset", "own", "rise", "rises")

    def __init__(self) -> None:
        self.offset = 0.0
        self.left = 0.0
        self.rise: _Rise | None = None
        self.rises: tuple[tuple[int, float], ...] = ()
        self.fired_ns: int | None = None
        self.own: OffsetEstimate | None = None
        self.insisting = _Insisting()

    def own_mean(self, now_ns: int) -> float:
        return 0.0 if self.own is None else self.own.mean(now_ns)

    def waits_ns(self, now_ns: int) -> int | None:
        """Until there is room for what the last word lets it rise; None: it rises no more."""
        if self.rise is None or self.rise.by(self.offset) <= _LEAST_LOG:
            return None
        return self.rises[0][0] + MINUTE_NS - now_ns

    def was_felt(self, now_ns: int) -> bool:
        return self.fired_ns is not None and now_ns - self.fired_ns <= FELT_NS

    def fired(self, now_ns: int) -> None:
        """Rises by what has room by now, or loses its rise after a minute without a pulse."""
        if self.was_felt(now_ns):
            self._rise(now_ns)
        else:
            self.offset, self.rise = min(self.offset, 0.0), None
        self.fired_ns = now_ns

    def _rise(self, now_ns: int) -> None:
        if self.rise is None or now_ns >= self.rise.until_ns:
            return
        self.rises = tuple([rise for rise in self.rises if now_ns - rise[0] < MINUTE_NS])
        room = _RISE_LOG - sum([by for _, by in self.rises])
        by = min(self.rise.by(self.offset), room)
        if by > _LEAST_LOG:
            self.offset += by
            self.left = min(0.0, self.left + by)
            self.rise.left -= by
            self.rises = (*self.rises, (now_ns, by))

    def let_go_to(self, wanted: float, now_ns: int, *, is_weak: bool, may_raise: bool) -> float:
        """Down where it may go down, and up as far as there is room. Returns how far it may."""
        if wanted < 0.0 and self.offset >= -BAND:
            wanted = 0.0
        least = self.offset if is_weak else min(self.offset, 0.0)
        # Whatever is expected: *good* is of the strength that there is.
        most = _MOST_LOG if is_weak and may_raise else max(self.offset, 0.0)
        wanted = min(max(wanted, least), most)
        self.offset = min(self.offset, wanted)
        self.rise = _Rise(wanted, now_ns)
        self._rise(now_ns)
        return wanted

    def lower_by(self, step: float, now_ns: int) -> None:
        """At once; and nothing rises until the next word, or within a minute."""
        if not self.was_felt(now_ns):
            # A rise that no pulse has any more.
            self.offset = min(self.offset, 0.0)
        self.offset -= step
        self.left = min(self.left - step, self.offset)
        self.rise = None
        self.rises = ((now_ns, _RISE_LOG),)


class FeltOffsets:
    """For all electrodes of an array; factors are 1 until somebody says something. `may_raise`:
    whether any may go above 1; otherwise what was lowered comes back, and no more.
    """

    def __init__(self, electrodes: int, *, may_raise: bool) -> None:
        self._may_raise = may_raise
        self._electrodes = [_Electrode() for _ in range(electrodes)]
        self._common = OffsetEstimate()
        self._insisting = _Insisting()
        #: The last *good* or *too weak* that counted: of what, and when.
        self._word: tuple[Answer, frozenset[int] | None, int] | None = None
        #: Whether any factor can differ from 1.
        self.is_idle = True

    def reset(self) -> None:
        """All that was said is gone."""
        self._electrodes = [_Electrode() for _ in self._electrodes]
        self._common = OffsetEstimate()
        self._insisting = _Insisting()
        self._word = None
        self.is_idle = True

    def fired(self, electrode: int, now_ns: int) -> None:
        """A pulse of a frame was fired at this electrode."""
        found = self._electrodes[electrode]
        if self.is_idle:
            found.fired_ns = now_ns
        else:
            found.fired(now_ns)

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

    def factors(self) -> tuple[float, ...]:
        """Of all electrodes, as of the last pulse of each."""
        return tuple([math.exp(electrode.offset) for electrode in self._electrodes])

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
            if each.rises and each.rises[-1][0] == now_ns:
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
        if electrodes is None:
            self._insisting.contradict()
        felt = [each for each in self._those(electrodes) if each.was_felt(now_ns)]
        is_lowered, rising = False, []
        for electrode in felt:
            before = electrode.offset
            target = electrode.let_go_to(
                self._wanted(electrode, now_ns),
                now_ns,
                is_weak=answer == "too_weak",
                may_raise=self._may_raise,
            )
            is_lowered = is_lowered or electrode.offset < before
            if target > before:
                # One word lets it rise by no more than that.
                rising.append(min(target, before + _RISE_LOG))
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
            shared = [electrode.offset - electrode.own_mean(now_ns) for electrode in felt]
            offset = sum(shared) / len(shared) if shared else 0.0
            self._common.hear(answer, offset, now_ns)
            return
        common = self._common.mean(now_ns)
        for electrode in self._those(electrodes):
            if electrode.own is None:
                electrode.own = OffsetEstimate()
            electrode.own.hear(answer, electrode.offset - common, now_ns)

    def _wanted(self, electrode: _Electrode, now_ns: int) -> float:
        return self._common.mean(now_ns) + electrode.own_mean(now_ns)

    def _those(self, electrodes: Sequence[int] | None) -> list[_Electrode]:
        if electrodes is None:
            return self._electrodes
        return [self._electrodes[number] for number in sorted(set(electrodes))]
