"""What a person says, together with a law by resistance: ten minutes through the real engine.

Owns: the answers as requests of the lease's holder, what became of the law, and that one that does
harm must be given up. Must not know: how answers are heeded, when a law is given up.

Eight electrodes at 5 Hz, which is slow enough that pulses do not add up to more than was wanted.
The person is asked for the strength of all of them, or each time of the next electrode alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.felt_person import Manner, Person, times_wanted
from bench.felt_play import ELECTRODES, LEVEL, MINUTES, wanted_alone
from bench.steady_figures import SteadyFigures, figures
from bench.steady_harm import Harm, Pooled
from bench.steady_laws import LAWS, NONE
from bench.steady_run import Scan, run
from bench.steady_skin import CALIBRATED_S, Finger
from engine_rig import LEASE, EngineRig
from engine_scenes import states
from etd.protocol.link import SayFelt
from etd.stabilize.offset_estimate import Answer
from etd_body.kinds import BodyKind
from etd_body.tissue import Floats

RATE_HZ = 5.0
_HEEDED_S = 5
#: Where a law that does harm need not be given up, and why the person's word does not tell it.
_UNEVEN = "single electrodes become uneven, and most of that is within what is called good"
UNTOLD: dict[BodyKind, str] = {BodyKind.INDIFFERENT: _UNEVEN, BodyKind.DUCTS: _UNEVEN}


class _Answers:
    """Once a minute, of what was felt in the five seconds before."""

    def __init__(self, person: Person, *, of_each: bool) -> None:
        self._person = person
        self._of_each = of_each
        self._asked = 0
        self._next_ns: int | None = None
        #: When the engine told that laws are off, in minutes from the first scan.
        self.off_min: float | None = None
        self._begun_ns = 0

    def watch(self, rig: EngineRig, finger: Finger, scans: Sequence[Scan]) -> None:
        now_ns = rig.clock.now_ns()
        if self._next_ns is None:
            self._begun_ns = now_ns
            self._next_ns = now_ns + int(self._person.again_s("good") * 1e9)
        if now_ns < self._next_ns or not scans:
            return
        lately = np.array([felt for _, felt, _ in scans[-int(_HEEDED_S * RATE_HZ) :]])
        answer = self._said(rig, lately, wanted_alone(finger))
        self._next_ns = now_ns + int(self._person.again_s(answer) * 1e9)
        told = states(rig)[-1].felt
        if self.off_min is None and told is not None and told.laws_off:
            self.off_min = (now_ns - self._begun_ns) / 60e9

    def _said(self, rig: EngineRig, lately: Floats, wanted: Floats) -> Answer:
        about: tuple[int, ...] | None = None
        if self._of_each:
            played = np.flatnonzero(wanted > 0.0)
            one = int(played[self._asked % len(played)])
            about, lately, wanted = (one,), lately[:, [one]], wanted[[one]]
        self._asked += 1
        answer = self._person.says(times_wanted(lately, wanted))
        heard = rig.ask(SayFelt, answer=answer, electrodes=about, lease=LEASE)
        assert heard.error is None, heard.reason
        return answer


@dataclass(frozen=True)
class WithLaw:
    """Of one finger: nothing, the law, and the law with answers. `off_min`: when it was given up;
    None: it was not. `of_each`: the person was asked about one electrode at a time.
    """

    body: BodyKind
    law: str
    seed: int
    plain: SteadyFigures
    alone: SteadyFigures
    said: SteadyFigures
    off_min: float | None
    of_each: bool

    @property
    def does_harm(self) -> bool:
        """The law alone, by the bounds of laws."""
        alone, plain = Pooled.of([self.alone]), Pooled.of([self.plain])
        return Harm(self.body, self.law, alone, plain, 1).is_out

    @property
    def is_held(self) -> bool:
        """A law that does harm is given up, but where that is known not to be told."""
        return not self.does_harm or self.off_min is not None or self.body in UNTOLD

    @property
    def verdict(self) -> str:
        harm = "does harm" if self.does_harm else "does no harm"
        given_up = "not given up" if self.off_min is None else f"given up at {self.off_min:.0f} min"
        return f"{harm}, {given_up}" + ("" if self.is_held else ": NOT MET")


def with_law(
    body: BodyKind,
    law: str,
    seed: int,
    manner: Manner,
    minutes: float = MINUTES,
    *,
    of_each: bool = False,
) -> WithLaw:
    answers = _Answers(Person(manner, seed), of_each=of_each)
    plain, alone = (_played(body, name, seed, minutes, None) for name in (NONE, law))
    said = _played(body, law, seed, minutes, answers)
    return WithLaw(body, law, seed, plain, alone, said, answers.off_min, of_each)


def _played(
    body: BodyKind, law: str, seed: int, minutes: float, answers: _Answers | None
) -> SteadyFigures:
    kept = run(
        seed,
        LAWS[law],
        LEVEL,
        minutes,
        None,
        electrodes=ELECTRODES,
        kind=body,
        rate_hz=RATE_HZ,
        from_s=CALIBRATED_S,
        watching=None if answers is None else answers.watch,
    )
    return figures(law, [kept])
