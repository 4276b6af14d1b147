"""What becomes of a skin in time: sweat, pressing, peeling and touching again.

Owns: the script: a pure function of its seed, the electrodes' places and the time. Asked twice for
the same time it says the same, in whatever order.
Must not know: circuits, nerves, boards, clocks.

All figures are [design]; sources give directions and sizes: resistance falls by 20 to 40 % within
1 to 3 minutes of contact, motion changes the area abruptly, and peeling leaves a small contact
that carries all of the current (Kajimoto, Electro-tactile Display, section 4, Figure 13).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from etd_body.tissue import Floats

#: An edge comes off in a moment; what touches again is small at first.
_PEEL_S = 0.08
_RETURN_S = 0.25
_FRONT_S = 0.12
_FIRST_AREA = 0.25
_LAST_AREA = 0.12
_PRESSING_HZ = (0.021, 0.047, 0.11, 0.23)
#: Area of contact goes with the cube root of pressure, about.
_HERTZ = 1.0 / 3.0


@dataclass(frozen=True, slots=True)
class Script:
    """How much of each there is. All zero: a skin that stays as it is."""

    #: The fraction of its resistance that sweat takes from a contact in the end.
    sweat: float = 0.0
    sweat_tau_s: float = 75.0
    #: Spread of the pressure's logarithm as the finger presses more and less.
    pressing: float = 0.0
    mean_pressure_kpa: float = 40.0
    #: How often an edge of the skin comes off the array, and for how long, in s.
    peels_per_min: float = 0.0
    peeled_s: tuple[float, float] = (0.4, 1.5)


STILL = Script()
#: A finger that lies there: it sweats, and moves a little.
LYING = Script(sweat=0.3, pressing=0.15)
#: A hand that does something: what the stabilizers are for.
BUSY = Script(sweat=0.35, pressing=0.5, peels_per_min=6.0)


@dataclass(frozen=True, slots=True)
class SkinNow:
    """Per electrode: `area` as a fraction of the electrode's, `wetness` 0..1 of what is to come."""

    area: Floats
    wetness: Floats
    #: Extra conductance by sweat: 1 is none.
    sweat_gain: Floats


class Course:
    def __init__(
        self, script: Script, positions_mm: Sequence[tuple[float, float]], *, seed: int
    ) -> None:
        self.script = script
        self._seed = seed
        places = np.array(positions_mm, dtype=float)
        self._middle_mm: Floats = places.mean(axis=0)
        places -= self._middle_mm
        self._reach_mm = max(float(np.abs(places).max()), 1e-9)
        self._places: Floats = places / self._reach_mm
        random = np.random.default_rng([seed, 2])
        count = len(places)
        self._sweaty = np.clip(random.normal(1.0, 0.25, count), 0.3, 1.7)
        self._tau_s = script.sweat_tau_s * np.exp(random.normal(0.0, 0.2, count))
        self._phases = random.uniform(0.0, 2.0 * pi, (3, len(_PRESSING_HZ)))

    def at(self, t_s: float) -> SkinNow:
        """The skin `t_s` after it first touched."""
        area = self._pressed(t_s) * self._attached(t_s)
        wetness = -np.expm1(-t_s / self._tau_s)
        lost = np.minimum(self.script.sweat * self._sweaty, 0.8) * wetness
        return SkinNow(area, wetness * min(1.0, self.script.sweat / 0.35), 1.0 / (1.0 - lost))

    def pressure_kpa(self, t_s: float) -> float:
        """What a sensor under the middle of the array would see."""
        return self.script.mean_pressure_kpa * float(np.exp(self._waves(t_s)[0]))

    def pressure_at_kpa(self, t_s: float, position_mm: tuple[float, float]) -> float:
        """What a sensor there would see; 0 while the skin is off the electrode nearest to it."""
        place = (np.array(position_mm) - self._middle_mm) / self._reach_mm
        nearest = int(((self._places - place) ** 2).sum(axis=1).argmin())
        if self._attached(t_s)[nearest] == 0.0:
            return 0.0
        return self.script.mean_pressure_kpa * float(np.exp(self._tilted(t_s, place)))

    def _pressed(self, t_s: float) -> Floats:
        return np.asarray(np.exp(_HERTZ * self._tilted(t_s, self._places)))

    def _tilted(self, t_s: float, places: Floats) -> Floats:
        """The logarithm of pressure at each of these places, in parts of the array's reach."""
        whole, to_x, to_y = self._waves(t_s)
        return np.asarray(whole + 0.5 * (to_x * places[..., 0] + to_y * places[..., 1]))

    def _waves(self, t_s: float) -> Floats:
        """The logarithm of pressure, and how it tilts to either side: three slow noises."""
        turns = 2.0 * pi * np.array(_PRESSING_HZ) * t_s + self._phases
        scale = self.script.pressing * (2.0 / len(_PRESSING_HZ)) ** 0.5
        return np.asarray(scale * np.sin(turns).sum(axis=1))

    def _attached(self, t_s: float) -> Floats:
        """1 where the skin lies on, 0 where it is off, and the ways between."""
        attached = np.ones(len(self._places))
        if self.script.peels_per_min <= 0.0:
            return attached
        window_s = 60.0 / self.script.peels_per_min
        window = int(t_s // window_s)
        for electrode in (window - 1, window):
            if electrode >= 0:
                attached *= self._peeled(electrode, window_s, t_s)
        return attached

    def _peeled(self, window: int, window_s: float, t_s: float) -> Floats:
        """One edge comes off within each window of time, from the outside inwards."""
        random = np.random.default_rng([self._seed, 3, window])
        angle, start, how_far = random.uniform(size=3)
        lasting_s = random.uniform(*self.script.peeled_s)
        outwards = self._places @ np.array([np.cos(2 * pi * angle), np.sin(2 * pi * angle)])
        inside = outwards.max() - outwards
        is_off = inside < 0.3 + 0.9 * how_far
        since_s = t_s - (window + 0.8 * start) * window_s - _FRONT_S * inside
        leaving = 1.0 - (1.0 - _LAST_AREA) * np.clip(since_s / _PEEL_S, 0.0, 1.0)
        back_s = since_s - _PEEL_S - lasting_s
        coming = _FIRST_AREA + (1.0 - _FIRST_AREA) * np.clip(back_s / _RETURN_S, 0.0, 1.0)
        off = np.where(since_s < _PEEL_S, leaving, np.where(back_s < 0.0, 0.0, coming))
        return np.asarray(np.where(is_off & (since_s > 0.0), off, 1.0))
