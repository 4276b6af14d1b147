"""What the person says of the strength, as the engine heeds it.

Owns: who may say what, the factors that follow (`stabilize/said.py`), what laws gave to the pulses
it was said of, and when laws are given up. Must not know: limits, hardware, sockets. Time comes in.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from etd.protocol.adaptation import why_not_raised
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.felt import HARDLY_ANYTHING, FeltDone, FeltFacts
from etd.protocol.link import SayFelt
from etd.stabilize.law_watch import LawWatch
from etd.stabilize.offset_estimate import Answer
from etd.stabilize.said import FeltOffsets, Followed

#: Currents are whole microamperes: a pulse with this part of what laws asked is what they asked.
_NEARLY = 0.98
_GIVES_BACK = "what was lowered comes back, by at most 5 % a minute, and no more than that ({})"
_NOT_BEFORE = (
    "it rises in {} s, if it is fired then: nothing does within a minute of too_strong, or of"
    " another rise"
)
_NOT_RAISED = (
    "nothing is lowered that could come back, and nothing is raised above the frame's own strength"
    " ({}): show a higher level, within its caps"
)
_NOT_BY_SITE = "felt_may_raise = false in the body site"
_NOT_WITHOUT = "no calibration tells that this person feels less in use"


class Feeling:
    """One per engine: what was said is gone when the supply is off, and laws that were given up
    stay so until the lease ends.
    """

    def __init__(self, electrodes: int, *, may_raise: bool) -> None:
        """`may_raise`: whether a level may get more than the frame's own, by the person's word, as
        the body site has it: then of whom it was measured that they feel less in use.
        """
        self._count = electrodes
        self._may_raise_here = may_raise
        self._why_not_raised = _NOT_WITHOUT if may_raise else _NOT_BY_SITE
        self._offsets = FeltOffsets(electrodes, may_raise=False)
        self._watch = LawWatch()
        self._gave = [1.0] * electrodes
        self._fired = [1.0] * electrodes
        self._word = [1.0] * electrodes
        self._answers = 0
        self._last: tuple[int, SayFelt] | None = None
        #: Why laws by resistance are off; empty: they are not.
        self.laws_off = ""

    def reset(self) -> None:
        """The supply was off."""
        self._offsets.reset()
        self._answers, self._last = 0, None
        self._gave = [1.0] * self._count
        self._fired = [1.0] * self._count
        self._word = [1.0] * self._count

    def lease_begun(self, calibrations: Sequence[Calibration] = ()) -> None:
        """Perhaps another person's: laws are judged anew. `calibrations`: theirs, if any. By each
        of them answers may raise, or by none: a word is about all polarities.
        """
        if self._may_raise_here:
            self._why_not_raised = _why_not_raised(calibrations)
        self._offsets = FeltOffsets(self._count, may_raise=not self._why_not_raised)
        self.reset()
        self._watch.reset()
        self.laws_off = ""

    # --- pulses ------------------------------------------------------------------------------

    def fired(self, electrode: int, part: float, now_ns: int) -> None:
        """A pulse of a frame was fired, with this part of the frame's charge."""
        self._word[electrode] = min(1.0, self._offsets.factor(electrode, now_ns))
        self._fired[electrode] = part
        self._offsets.fired(electrode, now_ns)

    def laws_gave(self, electrode: int, factor: float) -> None:
        """What laws made of the charge of its next pulse, in times of the frame's."""
        self._gave[electrode] = factor

    def factor(self, electrode: int, now_ns: int) -> float:
        """On the requested current of a pulse now."""
        return self._offsets.factor(electrode, now_ns)

    def felt_ua(self, electrode: int, current_ua: int) -> int | None:
        """What is left of a current since the person said too strong; None: all of it."""
        if self._offsets.is_idle:
            return None
        factor = self._offsets.left(electrode)
        return None if factor >= 1.0 else int(current_ua * factor)

    @property
    def is_lowered(self) -> bool:
        """Whether *too strong* has left less than all of any current."""
        return any(self._offsets.left(electrode) < 1.0 for electrode in range(self._count))

    def lowered(self) -> tuple[float, ...] | None:
        """The factor of each electrode; None where none is below 1."""
        if self._offsets.is_idle:
            return None
        factors = self._offsets.factors()
        return factors if min(factors) < 1.0 else None

    # --- answers -----------------------------------------------------------------------------

    def hear(self, said: SayFelt, now_ns: int) -> FeltDone:
        """Raises: Refused, and nothing changes."""
        self._check(said, now_ns)
        about = self._felt_of(said.electrodes, now_ns)
        if said.lease is not None and about:
            self._judge_laws(said.answer, about, now_ns)
        did: Followed = "lowered"
        if said.lease is None:
            self._offsets.lower(said.electrodes, now_ns)
        else:
            did = self._offsets.hear(said.answer, said.electrodes, now_ns)
        self._answers += 1
        self._last = now_ns, said
        return FeltDone(did=did, reason=self._why_no_more(said, did, now_ns))

    def _why_no_more(self, said: SayFelt, did: Followed, now_ns: int) -> str:
        if said.answer == "too_strong":
            return ""
        about = self._felt_of(said.electrodes, now_ns)
        least = min((self._offsets.left(electrode) for electrode in about), default=1.0)
        if least < HARDLY_ANYTHING:
            return _hardly_anything(least)
        waits_ns = self._offsets.waits_ns(said.electrodes, now_ns)
        later = "" if waits_ns is None else _NOT_BEFORE.format(math.ceil(waits_ns / 1e9))
        return "; ".join(filter(None, (later, self._why_not_higher(said.answer, did))))

    def _why_not_higher(self, answer: Answer, did: Followed) -> str:
        if answer != "too_weak" or did not in ("gives_back", "nothing"):
            return ""
        if self._why_not_raised:
            why = _NOT_RAISED if did == "nothing" else _GIVES_BACK
            return why.format(self._why_not_raised)
        if did == "gives_back":
            return ""
        return "it stays: this high already, or what was said before speaks against more"

    def _check(self, said: SayFelt, now_ns: int) -> None:
        for electrode in said.electrodes or ():
            if electrode >= self._count:
                raise Refused(
                    "bad_message",
                    f"there is no electrode {electrode}: this array has {self._count}, from 0 on",
                    electrode,
                )
        if said.answer == "too_strong":
            return
        for electrode in said.electrodes or ():
            if not self._offsets.was_felt(electrode, now_ns):
                raise Refused(
                    "wrong_state",
                    f"electrode {electrode} was not fired in the last minute"
                    f"{_what_to_do(self._offsets.left(electrode))}",
                    electrode,
                )
        if not self._offsets.felt(now_ns):
            raise Refused(
                "wrong_state",
                f"nothing was fired in the last minute{_what_to_do(max(self._offsets.factors()))}",
            )

    def _felt_of(self, electrodes: Sequence[int] | None, now_ns: int) -> tuple[int, ...]:
        """Those that an answer is about."""
        felt = self._offsets.felt(now_ns)
        return felt if electrodes is None else tuple([it for it in felt if it in electrodes])

    def _judge_laws(self, answer: Answer, about: Sequence[int], now_ns: int) -> None:
        # A current that a law took whole is as little as can be told.
        logs = [math.log(max(self._by_laws(electrode), 0.01)) for electrode in about]
        self._watch.hear(answer, math.exp(sum(logs) / len(logs)), now_ns)
        if self._watch.is_refuted and not self.laws_off:
            self.laws_off = (
                "laws by resistance are off until the lease ends: of the last"
                f" {self._watch.answers} answers where they changed the strength,"
                f" {self._watch.against} said the opposite"
            )

    def _by_laws(self, electrode: int) -> float:
        """What laws gave of its last pulse and limits left of it. What a cap or the soft start took
        is not theirs; nor what a word took, where the next one asks for more. Where it says that
        even so it is too strong, what laws add is against it.
        """
        gave, fired = self._gave[electrode], self._fired[electrode]
        if gave > 1.0:
            word = self._word[electrode]
            return max(1.0, min(gave, fired / word if word > 0.0 else gave))
        return gave if fired >= _NEARLY * gave else 1.0

    # --- reports -----------------------------------------------------------------------------

    def facts(self) -> FeltFacts | None:
        """None where nothing was said."""
        if self._last is None and not self.laws_off:
            return None
        said_ns, said = self._last or (0, None)
        return FeltFacts(
            answers=self._answers,
            said_ns=said_ns,
            answer=None if said is None else said.answer,
            electrodes=None if said is None else said.electrodes,
            lowers_only=said is not None and said.lease is None,
            factors=tuple([round(factor, 3) for factor in self._offsets.factors()]),
            laws_off=self.laws_off,
        )


def _why_not_raised(calibrations: Sequence[Calibration]) -> str:
    """Empty: answers may raise by all of them."""
    if not calibrations:
        return _NOT_WITHOUT
    each = (why_not_raised(made.adaptation, made.date) for made in calibrations)
    return next((why for why in each if why is not None), "")


def _hardly_anything(left: float) -> str:
    return f"too strong has left {left:.0%} of the current, and only disarming brings it back"


def _what_to_do(factor: float) -> str:
    """Where nothing was fired; too strong may have left less than a pulse."""
    if factor < HARDLY_ANYTHING:
        return f": {_hardly_anything(factor)}"
    return ": say it of what is felt now"
