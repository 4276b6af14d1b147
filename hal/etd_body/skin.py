"""The contacts of a whole array on a living skin, as they are now.

Owns: every electrode's resistances, capacitance, area and its bridges to neighbors, from what the
course says of the time, and from what was put under it.
Must not know: sources, what is connected, nerves.

Rp falls as the current rises (van Boxtel 1977; the shape a / (I + b) is [design]): the nominal
value holds at 5 mA, as the 50 kOhm of Kajimoto, Electro-tactile Display, section 3.1, do. Whether
the way in follows the resistance is a figure of the skin: see `kinds`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from etd_body.course import Course
from etd_body.electrode import (
    DRY_CAPACITANCE_NF,
    DRY_PARALLEL_OHM,
    DRY_SERIES_OHM,
    OPEN_CONTACT,
    Contact,
)
from etd_body.mesh import Gel, neighbors
from etd_body.tissue import Floats

_AT_UA = 5_000.0
_BEND_UA = 8_000.0
#: The way in widens a little faster than the resistance falls: 0.5 would be a disk of even
#: resistance [design].
_WIDENING = 0.8
#: Below this fraction of the electrode's area there is no contact.
_LEAST_AREA = 0.02


@dataclass(frozen=True, slots=True)
class SkinFigures:
    """The middle of a dry fingertip under electrodes of 1 mm, and the spread between them."""

    series_ohm: float = DRY_SERIES_OHM
    parallel_ohm: float = DRY_PARALLEL_OHM
    capacitance_nf: float = DRY_CAPACITANCE_NF
    area_sigma: float = 0.2
    diameter_mm: float = 1.0
    #: A film of sweat between two neighbors, when it is as wet as it gets.
    wet_bridge_ohm: float = 300_000.0
    #: Paste between all neighbors; inf is none.
    paste_bridge_ohm: float = float("inf")
    gel: Gel | None = None
    #: Rp falls to half from no current to this one.
    bend_ua: float = _BEND_UA
    #: The way in goes with the area of contact, and with what sweat conducts, to these powers: 1
    #: and 1 make feeling follow resistance, 0 and 0 ignore it, below 0 the way narrows.
    way_by_area: float = 1.0
    way_by_sweat: float = 1.0


def ease(current_ua: float, bend_ua: float = _BEND_UA) -> float:
    """Rp at this current, over its nominal value."""
    return (_AT_UA + bend_ua) / (current_ua + bend_ua)


class Skin:
    """`refresh` moves it to a time; the arrays are one number per electrode."""

    def __init__(
        self,
        figures: SkinFigures,
        course: Course,
        positions_mm: Sequence[tuple[float, float]],
        *,
        seed: int,
    ) -> None:
        count = len(positions_mm)
        self.figures = figures
        self.course = course
        self._area = np.exp(np.random.default_rng([seed, 4]).normal(0, figures.area_sigma, count))
        self._neighbors = neighbors(positions_mm)
        self._dry_bridge_s = 1.0 / figures.paste_bridge_ohm
        self._gel_ohm = 0.0
        if figures.gel is not None:
            self._gel_ohm = figures.gel.series_ohm(figures.diameter_mm)
            gap_mm = _least_gap_mm(positions_mm) - figures.diameter_mm
            self._dry_bridge_s += 1.0 / figures.gel.bridge_ohm(gap_mm, figures.diameter_mm)
        self._put: dict[int, Contact] = {}
        self.series_ohm: Floats = np.zeros(count)
        self.parallel_ohm: Floats = np.zeros(count)
        self.capacitance_nf: Floats = np.zeros(count)
        self.is_touching: NDArray[np.bool_] = np.zeros(count, dtype=bool)
        self.is_skin: NDArray[np.bool_] = np.ones(count, dtype=bool)
        self.gain: Floats = np.ones(count)
        #: The area that the current enters by, as a fraction of the electrode's.
        self.way_in: Floats = np.ones(count)
        self.bridges_s: Floats = np.zeros((count, count))
        self.has_bridges = False
        self.refresh(0.0)

    def refresh(self, t_s: float) -> None:
        """The contacts at `t_s`."""
        now, figures = self.course.at(t_s), self.figures
        area = self._area * now.area
        self.is_touching = area >= _LEAST_AREA
        self.gain = np.maximum(area, _LEAST_AREA) * now.sweat_gain
        by_area, by_sweat = figures.way_by_area, figures.way_by_sweat
        self.way_in = self.gain**by_area * now.sweat_gain ** (by_sweat - by_area)
        self.series_ohm = figures.series_ohm / self.gain + self._gel_ohm
        self.parallel_ohm = figures.parallel_ohm / self.gain
        self.capacitance_nf = figures.capacitance_nf * self.gain
        for electrode, contact in self._put.items():
            self._use(electrode, contact)
        # Pressing spreads what is there.
        wet = now.wetness * self.is_touching * area
        film = wet[:, None] * wet / figures.wet_bridge_ohm + self._dry_bridge_s
        self.bridges_s = self._neighbors * film
        self.has_bridges = bool(self.bridges_s.any())

    def put(self, electrode: int, contact: Contact) -> None:
        """From the next `refresh` on this lies under the electrode, whatever the course says."""
        self._put[electrode] = contact
        self.is_skin[electrode] = contact.kind == "skin"

    def contact(self, electrode: int) -> Contact:
        """As it is now, at 5 mA."""
        if electrode in self._put:
            return self._put[electrode]
        if not self.is_touching[electrode]:
            return OPEN_CONTACT
        return Contact(
            "skin",
            float(self.series_ohm[electrode]),
            float(self.parallel_ohm[electrode]),
            float(self.capacitance_nf[electrode]),
        )

    def parallel_at(self, electrode: int, current_ua: float) -> float:
        """One electrode's parallel resistance while `current_ua` passes it."""
        nominal_ohm = float(self.parallel_ohm[electrode])
        if not self.is_skin[electrode]:
            return nominal_ohm
        return nominal_ohm * ease(current_ua, self.figures.bend_ua)

    def conductance_at(self, current_ua: float) -> Floats:
        """Every electrode's way into the tissue while each passes so much; 0 where none touches."""
        bent = np.where(self.is_skin, ease(current_ua, self.figures.bend_ua), 1.0)
        return np.asarray(self.is_touching / (self.series_ohm + self.parallel_ohm * bent))

    def area_mm2(self, electrode: int) -> float:
        """Of the way in."""
        return float(self.way_in[electrode]) * pi * self.figures.diameter_mm**2 / 4.0

    def radius_mm(self) -> Floats:
        """Of the disk that the current enters by: a wetter contact is a wider one (Watanabe,
        Futami, Hoshimiya: thresholds follow the widening of the area that carries current).
        """
        return np.asarray(self.figures.diameter_mm / 2.0 * self.way_in**_WIDENING)

    def _use(self, electrode: int, contact: Contact) -> None:
        self.is_touching[electrode] = contact.kind != "open"
        if contact.kind == "open":
            return
        self.series_ohm[electrode] = contact.series_ohm
        self.parallel_ohm[electrode] = contact.parallel_ohm
        self.capacitance_nf[electrode] = contact.capacitance_nf
        nominal_ohm = self.figures.series_ohm + self.figures.parallel_ohm
        self.gain[electrode] = nominal_ohm / contact.resistance_ohm
        self.way_in[electrode] = self.gain[electrode] ** self.figures.way_by_area


def _least_gap_mm(positions_mm: Sequence[tuple[float, float]]) -> float:
    places = np.array(positions_mm, dtype=float)
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    return float(apart[apart > 0.0].min())
