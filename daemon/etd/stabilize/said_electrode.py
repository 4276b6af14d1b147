"""One electrode's factor on its current, by the person's word: what *too strong* takes of it, and
how far and how fast it rises.

Owns: the figures of the rules (`said.py` has the rules), and the state of one electrode. Must not
know: other electrodes, who says it, what is known of all in common.
"""

from __future__ import annotations

import math
from typing import Final

from etd.stabilize.offset_estimate import BAND, OffsetEstimate

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
MOST_LOG: Final = math.log(MOST)
RISE_LOG: Final = math.log(RISE_A_MINUTE)
#: Pulses that are no further apart are use: it was measured with one a second.
IN_USE_NS: Final = 2_000_000_000
#: By how much it is off when a person begins to say that it is weaker than at first: half of what
#: is called good anyway [design]. It is not known; too little made up for is better than too much.
WEAKER_AT: Final = BAND / 2.0
#: What has less than this left does not rise by any word: at 5 % a minute it would not be back
#: within an hour.
HARDLY_ANYTHING: Final = 0.05
#: Less than this is no rise but rounding.
LEAST_LOG: Final = 1e-9
#: No word takes more than to here: far below what any source fires, and still to divide by.
_FLOOR_LOG: Final = math.log(1e-6)
_HARDLY_LOG: Final = math.log(HARDLY_ANYTHING)


class Insisting:
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


class RiseRoom:
    """What took of the room of the last minute, when, and how much, as logarithms."""

    __slots__ = ("_taken",)

    def __init__(self) -> None:
        self._taken: tuple[tuple[int, float], ...] = ()

    def fill(self, now_ns: int) -> None:
        """Nothing rises within a minute."""
        self._taken = ((now_ns, RISE_LOG),)

    def take(self, wanted: float, now_ns: int) -> float:
        """As much of that as there is room for by now."""
        self._taken = tuple([taken for taken in self._taken if now_ns - taken[0] < MINUTE_NS])
        by = min(wanted, RISE_LOG - sum([by for _, by in self._taken]))
        if by <= LEAST_LOG:
            return 0.0
        self._taken = (*self._taken, (now_ns, by))
        return by

    def was_taken(self, now_ns: int) -> bool:
        """Whether some was just now."""
        return bool(self._taken) and self._taken[-1][0] == now_ns

    def waits_ns(self, now_ns: int) -> int:
        """Until there is more."""
        return self._taken[0][0] + MINUTE_NS - now_ns if self._taken else 0


class _Rise:
    """What the last word lets an electrode rise: to the offset `target`, by `left` at most, before
    `until_ns`.
    """

    __slots__ = ("left", "target", "until_ns")

    def __init__(self, target: float, now_ns: int) -> None:
        self.target: Final = target
        self.until_ns: Final = now_ns + LETS_RISE_NS
        self.left = RISE_LOG

    def by(self, offset: float) -> float:
        """From there."""
        return min(self.target - offset, self.left)


class _Use:
    """For how long it is in use without a minute's rest, and how much of that is after the last
    word about it. `is_made_up_for`: whether *good* makes up for what use takes, which it does not
    after *too strong*, until *too weak*.
    """

    __slots__ = ("is_made_up_for", "lasts_ns", "unanswered_ns")

    def __init__(self) -> None:
        self.lasts_ns = 0
        self.unanswered_ns = 0
        self.is_made_up_for = True

    def pulse(self, after_ns: int | None) -> None:
        """One so long after the last one; None: the first one."""
        if after_ns is None or after_ns > FELT_NS:
            self.lasts_ns = self.unanswered_ns = 0
        elif after_ns <= IN_USE_NS:
            self.lasts_ns += after_ns
            self.unanswered_ns += after_ns


class SaidElectrode:
    """`offset`: the logarithm of its factor; `left`: the same of a current that is named, which
    nothing raises above itself, so that *too strong* takes from that and not from a rise.
    """

    __slots__ = (
        "fired_ns",
        "insisting",
        "left",
        "offset",
        "own",
        "rise",
        "room",
        "use",
    )

    def __init__(self) -> None:
        self.offset = 0.0
        self.left = 0.0
        self.rise: _Rise | None = None
        self.room = RiseRoom()
        self.fired_ns: int | None = None
        self.use = _Use()
        self.own: OffsetEstimate | None = None
        self.insisting = Insisting()

    def own_mean(self, now_ns: int) -> float:
        return 0.0 if self.own is None else self.own.mean(now_ns)

    def lost(self, fades_a_minute: float) -> float:
        """How much of it use is expected to have taken by now; after *too strong*, no more than
        there is.
        """
        if self.offset < -LEAST_LOG:
            return 0.0
        lost = min(fades_a_minute * self.use.lasts_ns / MINUTE_NS, MOST_LOG)
        return lost if self.use.is_made_up_for else min(lost, max(self.offset, 0.0))

    def kept(self, fades_a_minute: float) -> float:
        """What makes up for what use has taken since the last word about it: of a minute, at most,
        and not more than has been lost in all.
        """
        lately = fades_a_minute * min(self.use.unanswered_ns, MINUTE_NS) / MINUTE_NS
        return max(0.0, min(self.lost(fades_a_minute), self.offset + lately))

    def waits_ns(self, now_ns: int) -> int | None:
        """Until there is room for what the last word lets it rise; None: it rises no more."""
        if self.rise is None or self.rise.by(self.offset) <= LEAST_LOG:
            return None
        return self.room.waits_ns(now_ns)

    @property
    def is_hardly_anything(self) -> bool:
        """Whether so little is left that no word gives it back."""
        return self.left < _HARDLY_LOG

    def was_felt(self, now_ns: int) -> bool:
        return self.fired_ns is not None and now_ns - self.fired_ns <= FELT_NS

    def fired(self, now_ns: int) -> None:
        """Rises by what has room by now, or loses its rise after a minute without a pulse."""
        if self.was_felt(now_ns):
            self._rise(now_ns)
        else:
            self.offset, self.rise = min(self.offset, 0.0), None
        self.use.pulse(None if self.fired_ns is None else now_ns - self.fired_ns)
        self.fired_ns = now_ns

    def _rise(self, now_ns: int) -> None:
        if self.rise is None or now_ns >= self.rise.until_ns:
            return
        by = self.room.take(self.rise.by(self.offset), now_ns)
        self.offset += by
        self.left = min(0.0, self.left + by)
        self.rise.left -= by

    def let_go_to(self, wanted: float, now_ns: int, *, is_weak: bool, most: float) -> float:
        """Down where it may go down, and up to `most` as far as there is room. Returns how far it
        may.
        """
        if wanted < 0.0 and self.offset >= -BAND:
            wanted = 0.0
        least = self.offset if is_weak else min(self.offset, 0.0)
        wanted = min(max(wanted, least), max(self.offset, most))
        self.offset = min(self.offset, wanted)
        self.use.unanswered_ns = 0
        self.rise = _Rise(wanted, now_ns)
        self._rise(now_ns)
        return wanted

    def lower_by(self, step: float, now_ns: int) -> None:
        """At once; and nothing rises until the next word, or within a minute."""
        if not self.was_felt(now_ns):
            # A rise that no pulse has any more.
            self.offset = min(self.offset, 0.0)
        self.offset = max(self.offset - step, _FLOOR_LOG)
        self.left = max(min(self.left - step, self.offset), _FLOOR_LOG)
        self.rise = None
        self.room.fill(now_ns)
        self.use.is_made_up_for = False


def fades_a_minute(weaker_from_s: float) -> float:
    """Of who says *weaker* from then on, as the logarithm of a factor: at most what may rise."""
    return min(WEAKER_AT * 60.0 / weaker_from_s, RISE_LOG)
