"""What a person says, together with a law by resistance: ten minutes through the real engine.

Owns: the answers as requests of the lease's holder, and what became of the law. Must not know: how
answers are heeded, when a law is given up.

Eight electrodes at 5 Hz, which is slow enough that pulses do not add up to more than was wanted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.felt_person import Manner, Person, times_wanted
from bench.felt_play import ELECTRODES, LEVEL, MINUTES, wanted_of
from bench.steady_figures import SteadyFigures, figures
from bench.steady_laws import LAWS, NONE
from bench.steady_run import Scan, run
from bench.steady_skin import Finger
from engine_rig import LEASE, EngineRig
from engine_scenes import states
from etd.protocol.link import SayFelt
from etd_body.kinds import BodyKind

RATE_HZ = 5.0
_HEEDED_S = 5


class _Answers:
    """Once a minute, of what was felt in the five seconds before."""

    def __init__(self, person: Person) -> None:
        self._person = person
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
        answer = self._person.says(times_wanted(lately, wanted_of(finger)))
        heard = rig.ask(SayFelt, answer=answer, lease=LEASE)
        assert heard.error is None, heard.reason
        self._next_ns = now_ns + int(self._person.again_s(answer) * 1e9)
        told = states(rig)[-1].felt
        if self.off_min is None and told is not None and told.laws_off:
            self.off_min = (now_ns - self._begun_ns) / 60e9


@dataclass(frozen=True)
class WithLaw:
    """Of one finger: nothing, the law, and the law with answers. `off_min`: when it was given up;
    None: it was not.
    """

    body: BodyKind
    law: str
    seed: int
    plain: SteadyFigures
    alone: SteadyFigures
    said: SteadyFigures
    off_min: float | None


def with_law(
    body: BodyKind, law: str, seed: int, manner: Manner, minutes: float = MINUTES
) -> WithLaw:
    answers = _Answers(Person(manner, seed))
    plain, alone = (_played(body, name, seed, minutes, None) for name in (NONE, law))
    said = _played(body, law, seed, minutes, answers)
    return WithLaw(body, law, seed, plain, alone, said, answers.off_min)


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
        watching=None if answers is None else answers.watch,
    )
    return figures(law, [kept])
