"""A skin that exists on paper: thresholds and pain by electrode, and presentations that arrive.

Owns: the spread, what was presented, and what it felt like. Must not know: procedures, daemons.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import exp

from etd.calibrate.person import Felt
from etd.calibrate.stimulator import Delivered


def resistance_ohm(current_ua: int) -> int:
    """Less at higher currents, and never the same."""
    return round(6.5e8 / (8_000 + current_ua))


@dataclass
class NoisySkin:
    """Keeps `asking.Presents`. Felt strength is current over threshold; pain begins at between 1.3
    and 4 times the threshold, as the literature has it: on some electrodes it is near.
    """

    electrodes: int
    seed: int
    median_ua: float = 1_100.0
    sigma: float = 0.3
    presented: list[tuple[int, int]] = field(default_factory=list)
    paused_s: float = 0.0
    kept: int = 0
    silences: int = 0
    #: All electrodes at once, and how many times stronger than each that is felt.
    wholes: list[dict[int, int]] = field(default_factory=list)
    summation: float = 1.0
    stops: int = 0
    #: Called with each presentation, before it arrives.
    meanwhile: Callable[[int, int], None] = lambda _, __: None
    #: Called in each pause, and in each silence.
    pausing: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        spread = random.Random(self.seed)
        each = range(self.electrodes)
        self.threshold_ua = [self.median_ua * exp(spread.gauss(0, self.sigma)) for _ in each]
        self.pain_ua = [value * spread.uniform(1.3, 4.0) for value in self.threshold_ua]
        self._whole: dict[int, int] = {}
        self._last = dict.fromkeys(each, 0)

    def present(self, electrode: int, current_ua: int) -> Delivered:
        self.meanwhile(electrode, current_ua)
        self.presented.append((electrode, current_ua))
        self._last[electrode], self._whole = current_ua, {}
        return Delivered(electrode, current_ua, resistance_ohm(current_ua))

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        for electrode, current_ua in currents_ua.items():
            self.meanwhile(electrode, current_ua)
        self.wholes.append(dict(currents_ua))
        self._whole = dict(currents_ua)
        electrode = max(currents_ua, key=currents_ua.__getitem__)
        return Delivered(electrode, currents_ua[electrode], None, rate_hz=47.4)

    def silence(self, electrode: int) -> Delivered:
        self.silences += 1
        self.pausing()
        self._last[electrode], self._whole = 0, {}
        return Delivered(electrode, 0, None)

    def pause(self, seconds: float) -> None:
        self.paused_s += seconds
        self.pausing()

    def keep(self) -> None:
        self.kept += 1

    def stop(self) -> None:
        self.stops += 1

    def sense(self, electrode: int) -> Felt:
        if self._whole:
            together = [self._felt(*one) for one in self._whole.items()]
            times = self.summation
            strength = max(felt.strength for felt in together)
            return Felt(times * strength, times * max(felt.pain for felt in together))
        return self._felt(electrode, self._last[electrode])

    def _felt(self, electrode: int, current_ua: int) -> Felt:
        return Felt(current_ua / self.threshold_ua[electrode], current_ua / self.pain_ua[electrode])

    def most_of_pain(self) -> float:
        """The nearest that any presentation came to pain; 1 is pain."""
        return max(current_ua / self.pain_ua[electrode] for electrode, current_ua in self.presented)

    def error(self, electrode: int, found_ua: int) -> float:
        """How far a threshold lies off the true one, as a part of it."""
        return abs(found_ua / self.threshold_ua[electrode] - 1.0)
