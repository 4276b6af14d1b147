"""What the person says of the strength, as the engine heeds it.

Owns: who may say what, the factors that follow (`stabilize/said.py`), what laws gave to the pulses
it was said of, and when laws are given up. Must not know: limits, hardware, sockets. Time comes in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from etd.protocol.adaptation import why_not_raised
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.felt import FeltDone, FeltFacts
from etd.protocol.link import SayFelt
from etd.stabilize.fired_ceiling import FiredCeilings
from etd.stabilize.law_watch import LawWatch
from etd.stabilize.offset_estimate import Answer
from etd.stabilize.said import FeltOffsets, Followed
from etd.stabilize.said_electrode import HARDLY_ANYTHING, fades_a_minute

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
#: A fall within what is called good anyway comes back by any answer, and is no case of these.
_DEEP = (
    "it stays: too_strong has left {:.0%} of it, and a fall that deep comes back only as far as all"
    " answers together say so; the same said again within half a minute is one answer: where it is"
    " too weak, say too_weak, and again after that"
)
_NAMED = (
    "levels are not below the frame's own strength; of a current_ua that a frame names too_strong"
    " has left {:.0%}, and good gives back no more than levels need: say too_weak where it is"
)
_CEILING = (
    "too_strong was said of what another limit had left: nothing {} {} uA at electrode {}, no soft"
    " start either; too_weak lets that rise by 5 % a minute, and disarming begins anew"
)
_FALLS = (
    "of what was raised above the frame's own strength, good takes what is not expected to be"
    " needed any more: where it is weaker then, say too_weak"
)
_CUT = (
    "another limit leaves less than is asked for, and no word raises that: the clamps of replies"
    " and scans tell which"
)
_NOT_FIRED = (
    "it was not fired since arming, where it may have been a return of others: what it is asked for"
    " later is lowered, and nothing else: name the electrodes that fire, or none for all"
)
_NOT_BY_SITE = "felt_may_raise = false in the body site"
_NOT_WITHOUT = "no calibration tells that this person feels less in use"


@dataclass(slots=True)
class _LastPulse:
    """Of an electrode: what laws made of the charge of its next one, in times of the frame's; which
    part of the frame's charge the last one had, and which part a word had left to it; and what was
    asked for before any word.
    """

    gave: float = 1.0
    part: float = 1.0
    word: float = 1.0
    asked_ua: int = 0


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
        self._pulses = [_LastPulse() for _ in range(electrodes)]
        self._ceilings = FiredCeilings(electrodes)
        self._answers = 0
        self._last: tuple[int, SayFelt] | None = None
        #: Why laws by resistance are off; empty: they are not.
        self.laws_off = ""

    def reset(self) -> None:
        """The supply was off."""
        self._offsets.reset()
        self._answers, self._last = 0, None
        self._pulses = [_LastPulse() for _ in range(self._count)]
        self._ceilings = FiredCeilings(self._count)

    def lease_begun(self, calibrations: Sequence[Calibration] = ()) -> None:
        """Perhaps another person's: laws are judged anew. `calibrations`: theirs, if any. By each
        of them answers may raise, or by none: a word is about all polarities.
        """
        if self._may_raise_here:
            self._why_not_raised = _why_not_raised(calibrations)
        self._offsets = FeltOffsets(
            self._count,
            may_raise=not self._why_not_raised,
            fades_a_minute=_fades_a_minute(calibrations),
        )
        self.reset()
        self._watch.reset()
        self.laws_off = ""

    # --- pulses ------------------------------------------------------------------------------

    def fired(
        self,
        electrode: int,
        part: float,
        now_ns: int,
        fired_ua: int,
        wanted_ua: int,
        asked_ua: int,
        *,
        by_array: bool = False,
        by_own: bool = False,
    ) -> None:
        """A pulse of a frame was fired, with this part of the frame's charge, and this current of
        what frame, laws and words wanted; `asked_ua`: before any word. `by_array`, `by_own`: a soft
        start had lowered it, that of the array or its electrode's own.
        """
        pulse = self._pulses[electrode]
        pulse.word = min(1.0, self._offsets.factor(electrode, now_ns))
        pulse.part, pulse.asked_ua = part, asked_ua
        self._ceilings.fired(
            electrode, fired_ua, wanted_ua, now_ns, by_array=by_array, by_own=by_own
        )
        self._offsets.fired(electrode, now_ns)

    def laws_gave(self, electrode: int, factor: float) -> None:
        """What laws made of the charge of its next pulse, in times of the frame's."""
        self._pulses[electrode].gave = factor

    def factor(self, electrode: int, now_ns: int) -> float:
        """On the requested current of a pulse now."""
        return self._offsets.factor(electrode, now_ns)

    def felt_ua(self, electrode: int, current_ua: int, *, may_be_raised: bool) -> int | None:
        """What is left of a current since the person said too strong; None: all of it.
        `may_be_raised`: by `factor`, which has what a word took of a rise.
        """
        if self._offsets.is_idle:
            return None
        by_word = self.word_ua(electrode, current_ua, may_be_raised=may_be_raised)
        most_ua = self._ceilings.most_ua(electrode)
        if most_ua == math.inf:
            return by_word
        return int(most_ua if by_word is None else min(by_word, most_ua))

    def word_ua(self, electrode: int, current_ua: int, *, may_be_raised: bool) -> int | None:
        """The same without what it says of pulses that other limits had lowered."""
        offsets = self._offsets
        factor = offsets.below(electrode) if may_be_raised else offsets.left(electrode)
        return None if factor >= 1.0 else int(current_ua * factor)

    @property
    def is_lowered(self) -> bool:
        """Whether *too strong* has left less than all of any current."""
        return bool(self._ceilings) or any(
            self._offsets.left(electrode) < 1.0 for electrode in range(self._count)
        )

    # --- answers -----------------------------------------------------------------------------

    def hear(self, said: SayFelt, now_ns: int) -> FeltDone:
        """Raises: Refused, and nothing changes."""
        self._check(said, now_ns)
        about = self._felt_of(said.electrodes, now_ns)
        if said.lease is not None and about:
            self._judge_laws(said.answer, about, now_ns)
        if said.answer == "too_strong":
            done = self._lower(said, about, now_ns)
        else:
            done = self._let_rise(said, said.answer, about, now_ns)
        self._answers += 1
        self._last = now_ns, said
        return done

    def _lower(self, said: SayFelt, about: Sequence[int], now_ns: int) -> FeltDone:
        """Of all that are named, when they were fired or not: a part of what is asked of them, and
        of what was fired where that was less.
        """
        those = range(self._count) if said.electrodes is None else sorted(set(said.electrodes))
        before = [self._offsets.left(electrode) for electrode in those]
        if said.lease is None:
            self._offsets.lower(said.electrodes, now_ns)
        else:
            self._offsets.hear(said.answer, said.electrodes, now_ns)
        left = {
            electrode: self._offsets.left(electrode) / left_before
            for electrode, left_before in zip(those, before, strict=True)
        }
        self._ceilings.lower(left, now_ns, are_all=said.electrodes is None)
        if said.electrodes and not any(self._ceilings.was_fired(each) for each in those):
            return FeltDone(did="nothing", reason=_NOT_FIRED)
        binding_ua = self._ceilings.binding_ua(about, now_ns)
        return FeltDone(did="lowered", reason=_of_ceilings("passes", binding_ua))

    def _let_rise(
        self, said: SayFelt, answer: Answer, about: Sequence[int], now_ns: int
    ) -> FeltDone:
        """What is wanted rises. Where more is wanted than fired, only a ceiling's rise is felt."""
        ceilings = self._ceilings
        bound_ua = ceilings.binding_ua(about, now_ns)
        did = self._offsets.hear(answer, said.electrodes, now_ns)
        rises = ceilings.let_rise(about, now_ns, is_weak=answer == "too_weak")
        are_cut = all(ceilings.is_limited(electrode) for electrode in about)
        waits_ns = self._offsets.waits_ns(said.electrodes, now_ns)
        if did == "nothing" or (are_cut and did != "lowered"):
            did, waits_ns = "nothing", None
            if rises:
                did, waits_ns = "gives_back", ceilings.waits_ns(about, now_ns)
        # *Too weak* lowers nothing.
        falls = _FALLS if did == "lowered" else ""
        later = "" if waits_ns is None else _NOT_BEFORE.format(math.ceil(waits_ns / 1e9))
        why = _of_ceilings("had passed", bound_ua)
        if did == "nothing":
            why = self._why_it_stays(answer, about, why, are_cut=are_cut)
        why = why or self._why_not_higher(answer, did)
        return FeltDone(did=did, reason="; ".join(filter(None, (falls, later, why))))

    def _left(self, electrode: int) -> float:
        """By the word, of what is asked or of what was fired."""
        return min(self._offsets.left(electrode), self._ceilings.left(electrode))

    def _why_it_stays(
        self, answer: Answer, about: Sequence[int], ceilings: str, *, are_cut: bool
    ) -> str:
        """Empty where nothing is lowered that could rise."""
        least = min((self._left(electrode) for electrode in about), default=1.0)
        if least < HARDLY_ANYTHING:
            return _hardly_anything(least)
        if ceilings:
            return ceilings
        if are_cut and (answer == "too_weak" or least < 1.0):
            return _CUT
        return self._why_lowered_stays(answer, about)

    def _why_lowered_stays(self, answer: Answer, about: Sequence[int]) -> str:
        """Empty where nothing of these is lowered, or it is told otherwise."""
        below = min((self._offsets.below(electrode) for electrode in about), default=1.0)
        if below < 1.0:
            return _DEEP.format(below)
        left = min((self._offsets.left(electrode) for electrode in about), default=1.0)
        return _NAMED.format(left) if answer == "good" and left < 1.0 else ""

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
                    f"{_what_to_do(self._left(electrode))}",
                    electrode,
                )
        if not self._offsets.felt(now_ns):
            most = max(self._left(electrode) for electrode in range(self._count))
            raise Refused("wrong_state", f"nothing was fired in the last minute{_what_to_do(most)}")

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
        pulse = self._pulses[electrode]
        gave, fired, word = pulse.gave, pulse.part, pulse.word
        if gave > 1.0:
            return max(1.0, min(gave, fired / word if word > 0.0 else gave))
        return gave if fired >= _NEARLY * gave else 1.0

    # --- reports -----------------------------------------------------------------------------

    def _of_asked(self, electrode: int) -> float:
        """What words leave of the current that was asked of its last pulse."""
        factor, asked_ua = self._offsets.last_factor(electrode), self._pulses[electrode].asked_ua
        return min(factor, self._ceilings.most_ua(electrode) / asked_ua) if asked_ua else factor

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
            factors=tuple([round(self._of_asked(each), 3) for each in range(self._count)]),
            laws_off=self.laws_off,
        )


def _of_ceilings(verb: str, each_ua: Mapping[int, float]) -> str:
    """The least of them; empty where there is none."""
    if not each_ua:
        return ""
    least = min(each_ua, key=each_ua.__getitem__)
    return _CEILING.format(verb, int(each_ua[least]), least)


def _why_not_raised(calibrations: Sequence[Calibration]) -> str:
    """Empty: answers may raise by all of them."""
    if not calibrations:
        return _NOT_WITHOUT
    each = (why_not_raised(made.adaptation, made.date) for made in calibrations)
    return next((why for why in each if why is not None), "")


def _fades_a_minute(calibrations: Sequence[Calibration]) -> float:
    """By that of them which says the least; 0 where one does not tell."""
    from_s = [
        None if made.adaptation is None else made.adaptation.weaker_from_s for made in calibrations
    ]
    told = [seconds for seconds in from_s if seconds is not None]
    return fades_a_minute(max(told)) if told and len(told) == len(from_s) else 0.0


def _hardly_anything(left: float) -> str:
    return f"too strong has left {left:.0%} of the current, and only disarming brings it back"


def _what_to_do(factor: float) -> str:
    """Where nothing was fired; too strong may have left less than a pulse."""
    if factor < HARDLY_ANYTHING:
        return f": {_hardly_anything(factor)}"
    return ": say it of what is felt now"
