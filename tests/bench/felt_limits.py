"""What the limits on raising leave to any rule: a rise at once, whatever anybody says.

Owns: that course of factors, played in place of a person's answers on the levels that they are
judged with. Must not know: how answers are heeded, how it is shown.

From the first minute on, when a person could answer first, all currents rise by as much as one
minute allows, until they may rise no more. Where a drift is common to all and makes everything
weaker, no rule that keeps these limits and hears nothing before gets there sooner.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

from msgspec import structs

from bench import felt_adaptation
from bench.felt_compared import felt_without, standard_error, variation_of
from bench.felt_person import ANSWERS_S, Manner
from bench.felt_play import MINUTES, Factors, Played, Unsaid, finger_of, played_of
from etd.stabilize.said_electrode import MINUTE_NS, MOST, RISE_A_MINUTE
from etd_body.kinds import BodyKind

_FIRST_NS = int(ANSWERS_S * 1e9)


class RisesAtOnce:
    """Implements `Factors`."""

    def of(self, electrode: int, now_ns: int) -> float:
        rises = 0 if now_ns < _FIRST_NS else 1 + (now_ns - _FIRST_NS) // MINUTE_NS
        return float(min(MOST, RISE_A_MINUTE**rises))

    def felt(self, times: float, now_ns: int) -> None: ...


@dataclass(frozen=True)
class Limit:
    """The variation over time with that rise, in times of that without, and its standard error over
    `fingers`: those that are felt without it.
    """

    body: BodyKind
    variation_times: float
    standard_error: float
    fingers: int


def limit(body: BodyKind, seeds: Sequence[int], manner: Manner, processes: int = 1) -> Limit:
    """By the levels that the measurement of adaptation leaves each finger's first person."""
    with ProcessPoolExecutor(processes) as pool:
        both = list(pool.map(partial(_both, body, manner), seeds))
    felt = [(*pair, electrodes) for pair in both if (electrodes := felt_without(pair[1]))]
    risen = [variation_of(one, electrodes) for one, _, electrodes in felt]
    plain = [variation_of(other, electrodes) for _, other, electrodes in felt]
    return Limit(body, sum(risen) / sum(plain), standard_error(risen, plain), len(plain))


def _both(body: BodyKind, manner: Manner, seed: int) -> tuple[Played, Played]:
    levels = felt_adaptation.measured(body, seed, manner, 0).levels

    def played(factors: Factors) -> Played:
        finger = finger_of(body, seed, MINUTES)
        calibration = structs.replace(finger.calibration, electrode=levels)
        return played_of(replace(finger, calibration=calibration), factors, "limits")

    return played(RisesAtOnce()), played(Unsaid())
