"""What one electrode looks like from its terminal to the common tissue under it.

Owns: the three numbers of a contact, its kinds, and the spread between electrodes.
Must not know: what the electrode is connected to, time.

Circuit: series resistance, then resistance and capacitance in parallel. The figures for a dry
fingertip are about 50 kOhm through an electrode of 1 mm (Kajimoto, Electro-tactile Display,
section 3.1), of which 1-3 kOhm in series, and 0.2-0.5 nF across the rest.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from math import exp, inf
from typing import Literal

ContactKind = Literal["skin", "open", "shorted", "load", "grounded"]

DRY_SERIES_OHM = 2_000.0
DRY_PARALLEL_OHM = 48_000.0
DRY_CAPACITANCE_NF = 0.3

#: What is left of a contact when metal or gel bridges it.
SHORT_OHM = 100.0


@dataclass(frozen=True, slots=True)
class Contact:
    """One electrode's way into the tissue.

    `parallel_ohm` 0 is a plain resistor of `series_ohm`; `series_ohm` inf is no way at all.
    "grounded" is a resistor to the board's ground, and no way into the tissue.
    """

    kind: ContactKind
    series_ohm: float
    parallel_ohm: float = 0.0
    capacitance_nf: float = 0.0

    @property
    def resistance_ohm(self) -> float:
        """Against a current that has flowed for long."""
        return self.series_ohm + self.parallel_ohm

    @property
    def conductance_s(self) -> float:
        return 0.0 if self.kind in ("open", "grounded") else 1.0 / self.resistance_ohm


OPEN_CONTACT = Contact("open", inf)
SHORTED_CONTACT = Contact("shorted", SHORT_OHM)


def skin(
    series_ohm: float = DRY_SERIES_OHM,
    parallel_ohm: float = DRY_PARALLEL_OHM,
    capacitance_nf: float = DRY_CAPACITANCE_NF,
) -> Contact:
    """An electrode on skin; without arguments the middle of a dry fingertip."""
    return Contact("skin", series_ohm, parallel_ohm, capacitance_nf)


def load(resistance_ohm: float) -> Contact:
    """A known resistor in the electrode's place."""
    if not 0 < resistance_ohm < inf:
        raise ValueError(f"a load has a resistance above 0 ohm, not {resistance_ohm}")
    return Contact("load", resistance_ohm)


def grounded(resistance_ohm: float) -> Contact:
    """A known resistor from the electrode to the board's ground."""
    return replace(load(resistance_ohm), kind="grounded")


def dry_fingertip(count: int, *, seed: int, sigma: float = 0.15) -> tuple[Contact, ...]:
    """`count` electrodes on one dry fingertip, the area under each spread log-normally.

    A larger contact has less of both resistances and more capacitance, in proportion.
    """
    spread = random.Random(seed)
    areas = [exp(spread.gauss(0.0, sigma)) for _ in range(count)]
    return tuple(
        skin(DRY_SERIES_OHM / area, DRY_PARALLEL_OHM / area, DRY_CAPACITANCE_NF * area)
        for area in areas
    )
