"""Bounds of what each contact conducts, from the samples of pulses that return through all others.

Owns: what the samples of one pulse give of the resistance on its path, and what all paths together
give of each contact. Must not know: which electrodes touch, the age of a reading, caps, ledgers,
hardware, clocks.

A pulse of electrode i passes its own contact, and then the way back through all others in parallel:

    path(i) = own(i) + back(i),    1 / back(i) = sum of 1 / own(k) over all k except i

Paths are measured, own resistances are needed. Bounds of the paths give bounds of these, each on
its safe side: the least own(i) is the least path(i) minus the most that the way back can be, which
follows from the least that the others conduct; the most own(i) is the other way round. Each round
tightens both bounds, and neither becomes wrong.

The board's leak is taken out: path = V / (I - V / leak), with the current of the DAC code. Both
bounds include one ADC step, and the least path is reduced by the voltage before the pulse. An error
that is common to all pulses (gain of the source, divider, leak) cancels in shares, as long as skin
does not resist much more than the leak.

Skin is a resistance in series with another one beside a capacitor, so the node rises during the
pulse. A sample lies below the end of the rise, so it gives the least path. The most path is the end
of the rise, which two samples bound in two ways; the lower bound counts. No time constant is longer
than `_LONGEST_TAU_US`, or than that by as much as the way back adds to the leak; and the step at
the beginning was made by at most `_MOST_SERIES_OHM` and the way back. Both figures are of dry skin
(0.2 to 0.5 nF, 1 to 3 k; van Boxtel 1977).

A pulse without a sample near its end, or with a step before it, gives the change of the path since
the last whole reading of that electrode, from like samples of both: that holds as long as the
contact rises as it did then. One whose early sample has changed by more than a third may be another
contact, with another time constant. Then, and without a whole reading, as for a person who gets no
wider pulses, the early sample is taken alone: it is the least, and the rise ends as with a time
constant of `_MOST_ASSUMED_TAU_US`. That is an assumption: skin with a longer time constant conducts
less than this module states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from etd.pulse.measured import BEND_UA
from etd_hal.boardfile import Source

#: When the samples of a pulse are taken, after its beginning and before its end, in us.
EARLY_US = 10.0
BEFORE_END_US = 6.0
#: Of a fingertip of 1 mm: 0.3 nF beside 50 k and a leak of 66 k.
ASSUMED_TAU_US = 8.5

#: 0.5 nF beside a leak of 66 k; and above every series resistance of skin that was published.
_LONGEST_TAU_US, _MOST_SERIES_OHM = 34.0, 5_000.0
_MOST_ASSUMED_TAU_US = 1.5 * ASSUMED_TAU_US
_NEAR_COMPLIANCE = 0.95
#: The uncertainty of a change by samples before the end of the rise, as a part of the change.
_SCALED_DOUBT = 0.2
#: By how much the early sample of the same contact changes. Without this bound one change of a
#: contact in four gave a least path that was too large, by up to 12 times.
_SAME_CONTACT = 1.33
#: Within two hundredths for 4 like electrodes, and closer for more.
_ROUNDS = 2
_STEPS = 4


class PathSamples:
    """The first phase of a pulse through all others, on skin that is charged by a probe at most.

    `early_v` was sampled EARLY_US after its beginning, `last_v` BEFORE_END_US before its end or, if
    `has_end` is False, with `early_v`; `resting_v` before the pulse.
    """

    __slots__ = ("code", "early_v", "has_end", "has_prepulse", "last_v", "resting_v", "width_us")

    def __init__(
        self,
        code: int,
        width_us: float,
        has_end: bool,
        has_prepulse: bool,
        resting_v: float,
        early_v: float,
        last_v: float,
    ) -> None:
        self.code: Final = code
        self.width_us: Final = width_us
        self.has_end: Final = has_end
        self.has_prepulse: Final = has_prepulse
        self.resting_v: Final = resting_v
        self.early_v: Final = early_v
        self.last_v: Final = last_v


class Whole:
    """A pulse with an early sample and one near its end, which bound the end of the rise. One ADC
    step is subtracted from the early sample and added to the last one.
    """

    __slots__ = ("current_ua", "early_v", "end_v", "last_v", "least_ohm", "resting_v", "spans")

    def __init__(
        self,
        current_ua: float,
        early_v: float,
        last_v: float,
        end_v: float,
        spans: float,
        least_ohm: float,
        resting_v: float,
    ) -> None:
        self.current_ua: Final = current_ua
        self.early_v: Final = early_v
        self.last_v: Final = last_v
        #: The most that the rise ends at, with a way back that resists nothing; inf near the
        #: compliance.
        self.end_v: Final = end_v
        #: The time between the samples, in units of EARLY_US; 0 if there was no last sample.
        self.spans: Final = spans
        self.least_ohm: Final = least_ohm
        #: What a probe before it had left.
        self.resting_v: Final = resting_v


class Reading:
    """The resistance of one path, from its last pulse; `most_ohm` may be inf. `scale`: the most
    path divided by that of `whole`.
    """

    __slots__ = ("current_ua", "least_ohm", "most_ohm", "scale", "whole")

    def __init__(
        self, current_ua: float, least_ohm: float, most_ohm: float, whole: Whole, scale: float = 1.0
    ) -> None:
        self.current_ua: Final = current_ua
        self.least_ohm: Final = least_ohm
        self.most_ohm: Final = most_ohm
        self.whole: Final = whole
        self.scale: Final = scale

    def differs(self, later: Reading) -> bool:
        """Whether no path has both readings, at whatever their currents make of its skin."""
        bend = (BEND_UA + self.current_ua) / (BEND_UA + later.current_ua)
        least_ohm, most_ohm = self.least_ohm * min(1.0, bend), self.most_ohm * max(1.0, bend)
        return later.most_ohm < least_ohm or later.least_ohm > most_ohm


class PathMeter:
    """Reads paths from the samples of pulses on one board."""

    def __init__(self, source: Source) -> None:
        self._leak_ohm = float(source.leak_ohm)
        self._step_v = source.node_uv_per_code / 1e6
        self._code_ua = source.full_scale_ua / (source.codes - 1)
        self._near_v = _NEAR_COMPLIANCE * source.compliance_v

    def read(self, samples: PathSamples, before: Reading | None) -> Reading | None:
        """The path of one pulse. `before`: the last reading of this electrode. None: the samples
        give no bound.
        """
        if samples.code == 0:
            return None
        if samples.has_end and not samples.has_prepulse:
            return self._whole(samples, samples.width_us - EARLY_US - BEFORE_END_US)
        scaled = None if before is None else self._scaled(samples, before.whole)
        if samples.has_prepulse or (scaled is None and before is not None):
            return scaled
        if scaled is not None and 1.0 / _SAME_CONTACT <= scaled.scale <= _SAME_CONTACT:
            return scaled
        return self._whole(samples, 0.0)

    def _whole(self, samples: PathSamples, span_us: float) -> Reading:
        current_ua, step_v = samples.code * self._code_ua, self._step_v
        early_v, last_v, spans = (
            samples.early_v - step_v,
            samples.last_v + step_v,
            span_us / EARLY_US,
        )
        end_v = math.inf if samples.last_v >= self._near_v else _end_v(early_v, last_v, spans, 1.0)
        resting_v = max(0.0, samples.resting_v)
        least_ohm = self._ohm(current_ua, samples.last_v - step_v - resting_v)
        whole = Whole(current_ua, early_v, last_v, end_v, spans, least_ohm, resting_v)
        return Reading(current_ua, least_ohm, self._ohm(current_ua, end_v), whole)

    def _scaled(self, samples: PathSamples, whole: Whole) -> Reading | None:
        """From the last samples of both or, where there is none now, from the early ones."""
        has_end, step_v, now_v = samples.has_end, self._step_v, samples.last_v
        if now_v >= self._near_v or (samples.has_prepulse and not (has_end and whole.spans)):
            return None
        then_v = whole.last_v - step_v if has_end else whole.early_v + step_v
        least_then_ohm = self._ohm(whole.current_ua, then_v - step_v)
        most_then_ohm = self._ohm(whole.current_ua, then_v + step_v)
        if least_then_ohm == 0.0 or most_then_ohm == math.inf:
            return None
        current_ua = samples.code * self._code_ua
        least_v = now_v - step_v - max(0.0, samples.resting_v)
        least_scale = self._ohm(current_ua, least_v) / most_then_ohm
        scale = self._ohm(current_ua, now_v + step_v) / least_then_ohm
        # With the leak beside it, a contact that has changed also has another time constant.
        doubt = 1.0 + _SCALED_DOUBT * abs(scale - 1.0)
        return Reading(
            current_ua,
            whole.least_ohm * least_scale / doubt,
            self._ohm(whole.current_ua, whole.end_v) * scale * doubt,
            whole,
            scale * doubt,
        )

    def most_ohm(self, reading: Reading, back_ohm: float) -> float:
        """The most that a path can resist, if its way back resists at most `back_ohm`."""
        whole = reading.whole
        if back_ohm == math.inf:
            return math.inf
        # The skin's capacitance is discharged through the leak and the way back.
        longer = 1.0 + back_ohm / self._leak_ohm
        end_v = _end_v(whole.early_v, whole.last_v, whole.spans, longer)
        most_ohm = max(reading.most_ohm, self._ohm(whole.current_ua, end_v) * reading.scale)
        series_s = 1.0 / (_MOST_SERIES_OHM + back_ohm)
        at_once_v = whole.resting_v + whole.current_ua / 1e6 / (series_s + 1.0 / self._leak_ohm)
        # By noise the early sample may read above the end.
        is_rise = at_once_v < whole.early_v <= whole.last_v
        if most_ohm == math.inf or not is_rise:
            return most_ohm
        for _ in range(_STEPS):
            # The rest of the rise grows with its end: from an upper bound, each step is one too.
            rise_v = end_v - whole.early_v
            left = rise_v / (end_v - at_once_v)
            end_v = min(end_v, whole.last_v + rise_v * left**whole.spans)
        return min(most_ohm, self._ohm(whole.current_ua, end_v) * reading.scale)

    def _ohm(self, current_ua: float, node_v: float) -> float:
        """V / (I - V / leak); inf where the leak takes the whole current."""
        through_ua = current_ua - node_v / self._leak_ohm * 1e6
        return max(0.0, node_v) / through_ua * 1e6 if through_ua > 0.0 else math.inf


class OwnBounds:
    """Of some contacts, in their order: the least and the most that each conducts, in S (`most_s`
    may be inf), and the most that the way back of each resists.
    """

    __slots__ = ("back_ohm", "least_s", "most_s")

    def __init__(self, least_s: list[float], most_s: list[float], back_ohm: list[float]) -> None:
        self.least_s: Final = least_s
        self.most_s: Final = most_s
        self.back_ohm: Final = back_ohm


def _end_v(early_v: float, last_v: float, spans: float, longer: float) -> float:
    """The most that a rise ends at, whose time constants are at most `longer` times the longest."""
    if not spans:
        return last_v / (1.0 - math.exp(-EARLY_US / (longer * _MOST_ASSUMED_TAU_US)))
    rest = math.exp(-spans * EARLY_US / (longer * _LONGEST_TAU_US))
    return last_v + max(0.0, last_v - early_v) * rest / (1.0 - rest)


def own_bounds(meter: PathMeter, readings: Sequence[Reading], beside_s: float) -> OwnBounds:
    """The bounds of contacts whose paths are read. `beside_s`: the most that all other contacts
    conduct together; inf if that is unknown.
    """
    least_s = [_inverse(reading.most_ohm) for reading in readings]
    most_s, back_ohm = _at_most(readings, least_s)
    paths_ohm = [
        meter.most_ohm(reading, back) for reading, back in zip(readings, back_ohm, strict=True)
    ]
    for _ in range(_ROUNDS):
        least_s = _at_least(paths_ohm, most_s, beside_s)
        most_s, back_ohm = _at_most(readings, least_s)
    return OwnBounds(least_s, most_s, back_ohm)


def _at_most(
    readings: Sequence[Reading], least_s: Sequence[float]
) -> tuple[list[float], list[float]]:
    """The most that each conducts, and the most that its way back resists."""
    whole_s = sum(least_s)
    back_ohm = [_inverse(whole_s - own_s) for own_s in least_s]
    most_s = [
        _inverse(reading.least_ohm - back) for reading, back in zip(readings, back_ohm, strict=True)
    ]
    return most_s, back_ohm


def _at_least(paths_ohm: Sequence[float], most_s: Sequence[float], beside_s: float) -> list[float]:
    """The least that each conducts: a way back resists at least what all others conduct at most."""
    unbound = most_s.count(math.inf)
    finite_s = beside_s + sum(own_s for own_s in most_s if own_s != math.inf)
    found = []
    for path_ohm, own_s in zip(paths_ohm, most_s, strict=True):
        is_finite = own_s != math.inf
        is_other_unbound = unbound > (0 if is_finite else 1)
        others_s = math.inf if is_other_unbound else finite_s - (own_s if is_finite else 0.0)
        own_ohm = path_ohm - _inverse(others_s)
        found.append(_inverse(own_ohm if own_ohm > 0.0 else path_ohm))
    return found


def _inverse(value: float) -> float:
    """Ohm from S, or S from ohm; inf for 0 and below."""
    return 1.0 / value if value > 0.0 else math.inf
