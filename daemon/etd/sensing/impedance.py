"""The skin's resistance to a long pulse under each electrode, from stimulus pulses alone.

Owns: the model of a contact (Rs in series with Rp beside Cp, all of it beside the board's leak),
what the samples of a pulse give of it, the filter across pulses, and when a value is rejected.
Must not know: what follows from it, contact, clocks (time comes in), hardware beyond its constants.

At a constant current I the node rises from V0, which Rs alone makes, to V_end with one time
constant:  V(t) = V_end - (V_end - V0) exp(-t / tau),  tau = Cp x (Rp beside (Rs + leak)). The word
stream gives two samples: 10 us after the beginning, and near the end of the pulse. With Rs assumed
(1 to 3 k on a fingertip) they give V_end and tau, hence Rp and Cp. A pulse below about 33 us has no
sample at its end: then V_end is *estimated* from the early one, with the tau of wider pulses before
it or an assumed one. With the assumed tau the early sample of any pulse gives the same *early*
estimate at any width, off by some 30 % where the skin's own time constant differs: it compares
short pulses with wider ones. Skin resists less at higher currents, and a weak probe reads far above
a stimulus (van Boxtel 1977): only pulses above the probe's current count here.

Rejected are: a node that is not at rest before the pulse, or that a pulse does not move (the ADC is
stuck, or reads another node), a saturated source, a resistance no skin has, and a resistance that
flickers. Flicker goes back and forth: an edge that comes off and lies down again is one step up and
one down, which the contact law handles; it takes some 80 ms each way, so three reversals in a row
come from the ADC [design]. A flickering value is accepted again after a second without a reversal.

A resistance that no pulse has measured for MAX_AGE_NS (`etd.pulse.measured`) is unknown: the
next pulse begins anew. Flicker is remembered, since it comes from the ADC rather than the skin.
"""

from __future__ import annotations

import math
from typing import Final, Literal

from etd.pulse.measured import MAX_SKIN_OHM, MIN_SKIN_OHM, is_stale
from etd.safety.conductance import ASSUMED_TAU_US, BEFORE_END_US, EARLY_US
from etd_hal.boardfile import Source

Quality = Literal["adc", "compliance", "implausible", "flicker"]

#: A fingertip of 1 mm: 1 to 3 k in series.
SERIES_OHM = 2_000.0
_SHORTEST_TAU_US, _LONGEST_TAU_US = 0.5, 60.0

#: With the DAC at zero the node is on ground, except for the ADC's offset and the charge left in
#: the skin: at most the offset, or this part of the pulse's own voltage, and never above the third;
#: or the voltage of a probe directly before the pulse: the sooner the pulse follows, the more of
#: that is left.
_OFFSET_V, _RESTING_PART, _RESTING_V = 0.3, 1.0 / 3.0, 5.0
#: A pulse moves the node by more ADC codes than this.
_STILL_CODES = 2
_NEAR_COMPLIANCE = 0.95

#: The filter: a new value's weight in the mean of logarithms, and the step that restarts it.
_WEIGHT = 0.25
#: Its time constant, for pulses at less than 60 Hz.
_TAU_NS = 58_000_000
_STEP = math.log(1.3)
#: Steps back and forth of this much, averaged over a few pulses, are noise and not skin. One
#: reversal counts as the second number at most, so that it takes three in a row.
_FLICKER, _MOST_OF_A_TURN = 0.1, 0.2
#: Flicker has ended after so long without a reversal, with a mean below this.
_CALM_NS, _CALM = 1_000_000_000, _FLICKER / 3.0


class _Skin:
    """The estimate of one electrode."""

    __slots__ = (
        "at_ua",
        "early_log_ohm",
        "flicker",
        "is_estimated",
        "is_flickering",
        "last_early_log_ohm",
        "last_log_ohm",
        "last_step",
        "log_ohm",
        "measured_ns",
        "quality",
        "rejected_ns",
        "reversed_ns",
        "tau_us",
    )

    def __init__(self) -> None:
        self.log_ohm: float | None = None
        self.early_log_ohm: float | None = None
        self.last_early_log_ohm: float | None = None
        #: The last pulse had no sample at its end, and no wider pulse has given a time constant.
        self.is_estimated = False
        self.last_log_ohm: float | None = None
        self.last_step = 0.0
        self.flicker = 0.0
        self.is_flickering = False
        self.reversed_ns = 0
        self.at_ua = 0
        self.tau_us: float | None = None
        self.quality: Quality | None = None
        self.measured_ns: int | None = None
        #: Rejections that have begun and not ended, and when each last occurred.
        self.rejected_ns: dict[Quality, int] = {}

    def begin_anew(self) -> None:
        """The estimate has expired: the next pulse counts as the first."""
        self.log_ohm = self.last_log_ohm = self.tau_us = self.measured_ns = None
        self.early_log_ohm = self.last_early_log_ohm = None
        self.last_step = 0.0

    def is_news(self, quality: Quality | None, now_ns: int) -> bool:
        """Whether a rejection begins. It ends with an accepted pulse when it has not occurred for a
        while: rejections now and then are one episode.
        """
        if quality is not None:
            is_news = quality not in self.rejected_ns
            self.rejected_ns[quality] = now_ns
            return is_news
        if self.rejected_ns:
            self.rejected_ns = {
                one: then_ns
                for one, then_ns in self.rejected_ns.items()
                if now_ns - then_ns < _CALM_NS
            }
        return False

    def note_step(self, step: float, now_ns: int) -> None:
        """Take a step of the logarithm; a step against the one before is a reversal."""
        before, self.last_step = self.last_step, step
        turned = min(abs(step), abs(before)) if step * before < 0.0 else 0.0
        if turned > _FLICKER:
            self.reversed_ns = now_ns
        self.flicker += _WEIGHT * (min(turned, _MOST_OF_A_TURN) - self.flicker)
        is_calm = self.flicker < _CALM and now_ns - self.reversed_ns >= _CALM_NS
        self.is_flickering = self.flicker > _FLICKER or (self.is_flickering and not is_calm)


class Samples:
    """The samples of a pulse; `end_v` is None where the pulse was too short."""

    __slots__ = ("commanded_ua", "early_v", "end_v", "probed_v", "resting_v", "width_us")

    def __init__(
        self,
        commanded_ua: int,
        width_us: float,
        resting_v: float,
        early_v: float,
        end_v: float | None,
        probed_v: float = 0.0,
    ) -> None:
        self.commanded_ua: Final = commanded_ua
        self.width_us: Final = width_us
        self.resting_v: Final = resting_v
        self.early_v: Final = early_v
        self.end_v: Final = end_v
        #: The voltage of the probe directly before the pulse; 0.0: none, or it was rejected.
        self.probed_v: Final = probed_v


class ImpedanceMap:
    def __init__(self, electrodes: int, source: Source) -> None:
        self._leak_ohm = float(source.leak_ohm)
        self._compliance_v = source.compliance_v
        self._resting_tolerance_v = (_STILL_CODES + 0.5) * source.node_uv_per_code / 1e6
        self._electrodes = electrodes
        #: A stabilizer compares with a reference that short pulses measured.
        self.is_early_wanted = False
        self.reset()

    def reset(self) -> None:
        """The supply was off: any contact may have changed."""
        self._skins = [_Skin() for _ in range(self._electrodes)]

    def skin_ohm(self, electrode: int, now_ns: int) -> float | None:
        """Rs + Rp, filtered; None where unknown, expired or rejected."""
        skin = self._skins[electrode]
        if skin.log_ohm is None or skin.quality is not None or is_stale(skin.measured_ns, now_ns):
            return None
        return math.exp(skin.log_ohm)

    def early_ohms(self, electrode: int) -> tuple[float | None, float | None]:
        """Of an electrode with a `skin_ohm`, the same as estimated from early samples alone, with
        the assumed time constant: filtered, and of the last pulse alone.
        """
        skin = self._skins[electrode]
        mean, last = skin.early_log_ohm, skin.last_early_log_ohm
        return (
            None if mean is None else math.exp(mean),
            None if last is None else math.exp(last),
        )

    def is_estimated(self, electrode: int) -> bool:
        """Whether `skin_ohm` is no more than the early estimate."""
        return self._skins[electrode].is_estimated

    def is_expired(self, electrode: int, now_ns: int) -> bool:
        """Whether there is a resistance that would be accepted if it were newer."""
        skin = self._skins[electrode]
        is_there = skin.log_ohm is not None and skin.quality is None
        return is_there and is_stale(skin.measured_ns, now_ns)

    def last_ohm(self, electrode: int) -> float | None:
        """Rs + Rp of the last pulse alone, however old; None where unknown or rejected."""
        skin = self._skins[electrode]
        if skin.last_log_ohm is None or skin.quality is not None:
            return None
        return math.exp(skin.last_log_ohm)

    def at_ua(self, electrode: int) -> int:
        """The current of the last measurement."""
        return self._skins[electrode].at_ua

    def capacitance_nf(self, electrode: int, now_ns: int) -> float | None:
        """Cp, where a pulse was wide enough to measure it."""
        return self._capacitance_nf(electrode, self.skin_ohm(electrode, now_ns))

    def reported_ohm_nf(self, electrode: int, now_ns: int) -> tuple[int | None, float | None]:
        """For reports: `skin_ohm` and `capacitance_nf`, rounded."""
        skin_ohm = self.skin_ohm(electrode, now_ns)
        if skin_ohm is None:
            return None, None
        nf = self._capacitance_nf(electrode, skin_ohm)
        return round(skin_ohm), None if nf is None else round(nf, 3)

    def _capacitance_nf(self, electrode: int, skin_ohm: float | None) -> float | None:
        skin = self._skins[electrode]
        if skin_ohm is None or skin.tau_us is None or skin_ohm <= SERIES_OHM:
            return None
        way_ohm = SERIES_OHM + self._leak_ohm
        parallel_ohm = skin_ohm - SERIES_OHM
        return skin.tau_us * 1e3 * (1.0 / parallel_ohm + 1.0 / way_ohm)

    def update(self, electrode: int, samples: Samples, now_ns: int) -> Quality | None:
        """Take the samples of a stimulus pulse. Returns why they are rejected, when that begins."""
        skin = self._skins[electrode]
        if is_stale(skin.measured_ns, now_ns):
            skin.begin_anew()
        skin.quality = self._read(skin, samples, now_ns)
        return skin.quality if skin.is_news(skin.quality, now_ns) else None

    def is_adc_suspect(
        self, resting_v: float, early_v: float, last_v: float, probed_v: float = 0.0
    ) -> bool:
        """Whether the samples before a pulse, early in it and last come from a stuck ADC (stuck at
        zero, it only shows no skin), or from a node that was not at rest, beyond the voltage of a
        probe directly before.
        """
        if resting_v <= 0.0:
            return False
        moved_v = max(abs(early_v - resting_v), abs(last_v - resting_v))
        stands_still = moved_v < self._resting_tolerance_v
        most_v = min(max(_OFFSET_V, _RESTING_PART * last_v), _RESTING_V)
        return stands_still or resting_v > max(most_v, probed_v)

    def _read(self, skin: _Skin, samples: Samples, now_ns: int) -> Quality | None:
        last_v = samples.early_v if samples.end_v is None else samples.end_v
        if self.is_adc_suspect(samples.resting_v, samples.early_v, last_v, samples.probed_v):
            return "adc"
        if last_v >= _NEAR_COMPLIANCE * self._compliance_v:
            return "compliance"
        is_estimated = samples.end_v is None and skin.tau_us is None
        log_ohm = self._log_ohm(samples.commanded_ua, self._end_v(skin, samples))
        if log_ohm is None:
            return "implausible"
        weight = _weight(skin.measured_ns, now_ns)
        skin.at_ua, skin.measured_ns, skin.is_estimated = samples.commanded_ua, now_ns, is_estimated
        last, skin.last_log_ohm = skin.last_log_ohm, log_ohm
        skin.note_step(0.0 if last is None else log_ohm - last, now_ns)
        skin.log_ohm = _mean(skin.log_ohm, log_ohm, weight)
        if is_estimated or self.is_early_wanted or skin.early_log_ohm is not None:
            early = self._log_ohm(samples.commanded_ua, self._estimated_v(samples, ASSUMED_TAU_US))
            skin.last_early_log_ohm = early
            skin.early_log_ohm = None if early is None else _mean(skin.early_log_ohm, early, weight)
        return "flicker" if skin.is_flickering else None

    def _log_ohm(self, commanded_ua: int, end_v: float) -> float | None:
        """The logarithm of the resistance; None where no skin has it."""
        through_ua = commanded_ua - end_v / self._leak_ohm * 1e6
        if through_ua <= 0.02 * commanded_ua:
            return None
        skin_ohm = end_v / through_ua * 1e6
        return math.log(skin_ohm) if MIN_SKIN_OHM <= skin_ohm <= MAX_SKIN_OHM else None

    def _series_v(self, samples: Samples) -> float:
        return samples.commanded_ua / 1e6 / (1.0 / SERIES_OHM + 1.0 / self._leak_ohm)

    def _estimated_v(self, samples: Samples, tau_us: float) -> float:
        """The voltage at which the node would settle, by the early sample alone."""
        left = math.exp(-EARLY_US / tau_us)
        return (samples.early_v - self._series_v(samples) * left) / (1.0 - left)

    def _end_v(self, skin: _Skin, samples: Samples) -> float:
        """The voltage at which the node would settle."""
        if samples.end_v is None:
            return self._estimated_v(samples, skin.tau_us or ASSUMED_TAU_US)
        series_v = self._series_v(samples)
        late = (samples.width_us - BEFORE_END_US) / EARLY_US
        end_v = samples.end_v
        if not series_v < samples.early_v < end_v:
            # A plain resistor, or a capacitance that the series part hides.
            return end_v
        left = 0.0
        for _ in range(4):
            left = (end_v - samples.early_v) / (end_v - series_v)
            at_end = left**late
            end_v = (samples.end_v - series_v * at_end) / (1.0 - at_end)
        tau_us = -EARLY_US / math.log(left) if left > 0.0 else _SHORTEST_TAU_US
        skin.tau_us = min(max(tau_us, _SHORTEST_TAU_US), _LONGEST_TAU_US)
        return end_v


def _weight(before_ns: int | None, now_ns: int) -> float:
    """The weight of a new value: more where pulses are rare, since skin changes with time."""
    elapsed_ns = now_ns - (now_ns if before_ns is None else before_ns)
    return max(_WEIGHT, 1.0 - math.exp(-elapsed_ns / _TAU_NS))


def _mean(before: float | None, log_ohm: float, weight: float) -> float:
    """The mean of logarithms; a step restarts it."""
    if before is None or abs(log_ohm - before) > _STEP:
        return log_ohm
    return before + weight * (log_ohm - before)
