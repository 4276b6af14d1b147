"""The membrane of a nerve as a linear circuit: what a step of potential outside does inside.

Owns: equations 7 and 9-17 of Kajimoto, Electro-tactile Display, as one system of equations that is
solved exactly, by its modes. Must not know: where nerves lie, electrodes, skin.

    C dV/dt = -A V + drive            V: membrane voltage, inside less outside, one a node

Units: mV, us, uS and pF (so that pF / uS is us).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from etd_body.tissue import Floats

#: Bisection ends when a width or a height is known to this fraction.
_PRECISION = 1e-9


@dataclass(frozen=True, slots=True)
class NerveConstants:
    """Per node: section 2.2.1 has G_a with the square of the diameter, C_m and G_m with it."""

    inside_us: float
    membrane_us: float
    capacitance_pf: float

    @classmethod
    def of_diameter(cls, diameter_um: float) -> NerveConstants:
        """[design] figures, chosen for a strength-duration time of 151 us in a 10 um fibre (that
        of rapidly adapting afferents after Kaczmarek et al. 2000).
        """
        return cls(
            INSIDE_US_PER_UM2 * diameter_um**2,
            MEMBRANE_US_PER_UM * diameter_um,
            MEMBRANE_US_PER_UM * diameter_um * MEMBRANE_TAU_US,
        )


MEMBRANE_US_PER_UM = 1e-3
INSIDE_US_PER_UM2 = 0.25e-3
MEMBRANE_TAU_US = 700.0


class Membrane:
    """Modes of one or many systems of the same size: leading axes of the arrays are kept."""

    def __init__(self, matrix_us: Floats, capacitance_pf: Floats) -> None:
        """`matrix_us` (..., nodes, nodes), symmetric; `capacitance_pf` (..., nodes)."""
        root = np.sqrt(capacitance_pf)
        scaled = matrix_us / (root[..., :, None] * root[..., None, :])
        rates, vectors = np.linalg.eigh(scaled)
        #: 1/us, (..., modes)
        self.rates: Floats = np.asarray(rates)
        self._out: Floats = vectors / root[..., :, None]

    def shapes(self, drive: Floats) -> Floats:
        """How far each mode is driven to in the end, seen at each node: (..., nodes, modes).

        `drive` (..., nodes), in uS mV.
        """
        into = np.einsum("...nm,...n->...m", self._out, drive) / self.rates
        return np.asarray(self._out * into[..., None, :])

    def step_response(self, drive: Floats, t_us: float) -> Floats:
        """V in mV at each node, `t_us` after the drive was switched on: (..., nodes)."""
        grown = -np.expm1(-self.rates * t_us)
        return np.asarray((self.shapes(drive) * grown[..., None, :]).sum(axis=-1))

    def final(self, drive: Floats) -> Floats:
        """V in mV when the drive has stood for ever: the rheobase's response."""
        return np.asarray(self.shapes(drive).sum(axis=-1))


def simplified(constants: NerveConstants) -> Membrane:
    """The nerve of Figure 5 (section 2.2): one node, grounded inside through G_a."""
    total = constants.inside_us + constants.membrane_us
    return Membrane(np.array([[total]]), np.array([constants.capacitance_pf]))


def simplified_response(constants: NerveConstants, height_mv: float, t_us: float) -> float:
    """V_m of Figure 6: the response to a step of -height outside (equations 12 to 14)."""
    drive = np.array([constants.inside_us * height_mv])
    return float(simplified(constants).step_response(drive, t_us)[0])


def least_height(response_of_unit: float, threshold_mv: float) -> float:
    """The height at which a linear response just reaches the threshold (equation 15)."""
    return threshold_mv / response_of_unit if response_of_unit > 0.0 else float("inf")


def minimum(energy: Callable[[float], float], low: float, high: float) -> float:
    """Where a function with one minimum has it (golden section), as section 2.2.2 asks for."""
    ratio = (5.0**0.5 - 1.0) / 2.0
    while high - low > _PRECISION * high:
        left, right = high - ratio * (high - low), low + ratio * (high - low)
        if energy(left) < energy(right):
            high = right
        else:
            low = left
    return (low + high) / 2.0
