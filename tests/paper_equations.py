"""The paper's equations, solved by scipy: what `etd explain` and docs/body.md are compared with.

Owns: equations 1 to 5 and 9 to 10 of Kajimoto, Electro-tactile Display, as they stand there, for an
ODE solver; the potential as the integral of the current density. Must not know: any code of the
body. The figures that the paper leaves open, [design], are those of the tables in docs/body.md,
typed a second time.

Units: mV, us, uS, pF (so that pF / uS is us), uA, mm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import cos, hypot, inf, pi, sin

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import dblquad, quad, solve_ivp
from scipy.optimize import brentq

Floats = NDArray[np.float64]

RESISTIVITY_OHM_M = 2.5
THRESHOLD_MV = 15.0
MEMBRANE_US_PER_UM = 1e-3
INSIDE_US_PER_UM2 = 0.25e-3
MEMBRANE_TAU_US = 700.0
SPACING_MM = 0.25
ENTRY_RADIUS_MM = 0.5
#: Longer than any membrane takes to settle: twenty of its time constants.
FOR_EVER_US = 20.0 * MEMBRANE_TAU_US
#: Relative tolerance of the solver.
_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Nerve:
    """One node's constants. Section 2.2.1: G_a with the square of the diameter, C_m and G_m with
    the diameter.
    """

    inside_us: float
    membrane_us: float
    capacitance_pf: float


def nerve(diameter_um: float) -> Nerve:
    membrane_us = MEMBRANE_US_PER_UM * diameter_um
    return Nerve(INSIDE_US_PER_UM2 * diameter_um**2, membrane_us, membrane_us * MEMBRANE_TAU_US)


@dataclass(frozen=True)
class Fibre:
    """A row of the table of fibres. `ending`: how many nodes' membrane the upper end is worth."""

    is_vertical: bool
    diameter_um: float
    depth_mm: float
    nodes: int
    ending: float = 40.0

    def points_mm(self) -> list[tuple[float, float]]:
        """(beside the axis, depth) of each node."""
        if self.is_vertical:
            return [(0.0, self.depth_mm + SPACING_MM * n) for n in range(self.nodes)]
        half = (self.nodes - 1) / 2.0
        return [(SPACING_MM * (n - half), self.depth_mm) for n in range(self.nodes)]


TOUCH_VERTICAL = Fibre(True, 10.0, 0.4, 19)
TOUCH_PARALLEL = Fibre(False, 10.0, 0.55, 25)
PAIN_VERTICAL = Fibre(True, 1.5, 0.25, 19)
PAIN_PARALLEL = Fibre(False, 1.7, 0.25, 25)


#: A dry fingertip under 1 mm, and the board of the paper's section 3.1 with its leak.
SERIES_OHM, PARALLEL_OHM, CAPACITANCE_F = 2_000.0, 48_000.0, 0.3e-9
LEAK_OHM, COMPLIANCE_V = 66_000.0, 300.0


# --- section 2.1: potentials ---------------------------------------------------------------------


def point_mv(distance_mm: float, current_ua: float) -> float:
    """The field, rho times the current density on a hemisphere, integrated from far away."""

    def field(r: float) -> float:
        return RESISTIVITY_OHM_M * current_ua / (2.0 * pi * r * r)

    return float(quad(field, distance_mm, inf, epsabs=0.0, epsrel=1e-12)[0])


def ring_mv(x_mm: float, depth_mm: float, radius_mm: float, current_ua: float) -> float:
    """Of an even current through a circle around the origin."""

    def part(angle: float) -> float:
        across = hypot(x_mm - radius_mm * cos(angle), radius_mm * sin(angle))
        return point_mv(hypot(across, depth_mm), current_ua) / (2.0 * pi)

    return float(quad(part, 0.0, 2.0 * pi, epsabs=0.0, epsrel=1e-10)[0])


@cache
def disk_mv(x_mm: float, depth_mm: float) -> float:
    """Of 1 uA, even over the disk of an electrode's entry."""

    def part(angle: float, radius: float) -> float:
        across = hypot(x_mm - radius * cos(angle), radius * sin(angle))
        return radius * RESISTIVITY_OHM_M / (2.0 * pi * hypot(across, depth_mm))

    whole = dblquad(part, 0.0, ENTRY_RADIUS_MM, 0.0, 2.0 * pi, epsabs=1e-9, epsrel=1e-7)[0]
    return float(whole / (pi * ENTRY_RADIUS_MM**2))


def curvature(potential_mv: Callable[[float], float], x_mm: float, step_mm: float = 0.02) -> float:
    """The second derivative, in mV/mm2, by five points: the fourth order of the step."""
    weights = {-2: -1.0, -1: 16.0, 0: -30.0, 1: 16.0, 2: -1.0}
    total = sum(weight * potential_mv(x_mm + n * step_mm) for n, weight in weights.items())
    return total / (12.0 * step_mm**2)


# --- section 2.2: one node -----------------------------------------------------------------------


def one_node(diameter_um: float, until_us: float) -> Callable[[float], float]:
    """V_m in mV at a time, after a step of -1 mV outside: equations 9 and 10."""
    it = nerve(diameter_um)

    def change(_t_us: float, v_m: Floats) -> Floats:
        inside_mv = v_m + -1.0
        current = -it.inside_us * inside_mv
        return np.asarray((current - it.membrane_us * v_m) / it.capacitance_pf)

    found = _solved(change, 1, until_us)
    return lambda t_us: float(found(t_us)[0])


def step_threshold_mv(diameter_um: float, width_us: float) -> float:
    """The height at which the pulse's end is at the threshold, found by trying heights."""
    reached = one_node(diameter_um, width_us)(width_us)
    return _height(lambda height: height * reached)


# --- equations 1 to 5: a fibre -------------------------------------------------------------------


@cache
def fibre_response(fibre: Fibre, way: float) -> Callable[[float], Floats]:
    """V_m in mV at every node at a time, 1 uA being switched on at 0 and never off."""
    it = nerve(fibre.diameter_um)
    outside_mv = way * np.array([disk_mv(abs(x), depth) for x, depth in fibre.points_mm()])
    size = np.ones(fibre.nodes)
    if fibre.is_vertical:
        size[0] = fibre.ending

    def change(_t_us: float, v_m: Floats) -> Floats:
        inside_mv = v_m + outside_mv  # equation 1
        along = np.empty(fibre.nodes + 1)  # I(n), into node n from the one before
        along[1:-1] = -it.inside_us * np.diff(inside_mv)  # equation 4
        # Beyond the last node it goes on, with V_m as it is there and Psi in a straight line.
        along[-1] = -it.inside_us * (outside_mv[-1] - outside_mv[-2])
        beyond = -it.inside_us * (outside_mv[1] - outside_mv[0])
        along[0] = 0.0 if fibre.is_vertical else beyond  # an ending is sealed
        membrane_current = along[:-1] - along[1:]  # equation 3
        return np.asarray(  # equation 2
            (membrane_current - it.membrane_us * size * v_m) / (it.capacitance_pf * size)
        )

    return _solved(change, fibre.nodes, FOR_EVER_US)


def fibre_threshold_ua(fibre: Fibre, way: float, width_us: float) -> float:
    """The current at which some node reaches the threshold, during the pulse or after it."""
    stepped = fibre_response(fibre, way)
    later = np.linspace(width_us, min(width_us + 500.0, FOR_EVER_US), 40)
    # Ending a step is the same step the other way, later.
    reached = max(
        float((stepped(t_us) - stepped(max(0.0, t_us - width_us))).max()) for t_us in later
    )
    return _height(lambda height: height * reached)


# --- section 3.1: what passes the skin -----------------------------------------------------------


def parallel_ohm(current_a: float) -> float:
    """Rp falls with the current, by the table of docs/body.md."""
    return PARALLEL_OHM * 13e-3 / (current_a + 8e-3)


def passed_ua(commanded_ua: float, width_us: float, returns: int) -> float:
    """The mean current through one electrode's skin, against others of the same skin: the circuit
    of leak, Rs, Rp parallel to Cp and the returns' resistance, integrated through the pulse.
    """
    told_a = commanded_ua * 1e-6

    def current_a(held_v: float) -> float:
        def excess_v(passing_a: float) -> float:
            each_ohm = SERIES_OHM + parallel_ohm(passing_a / returns)
            node_v = min((told_a - passing_a) * LEAK_OHM, COMPLIANCE_V)
            return node_v - passing_a * (SERIES_OHM + each_ohm / returns) - held_v

        return float(brentq(excess_v, -told_a, told_a, rtol=1e-10))

    def change(_t_us: float, state: Floats) -> Floats:
        passing_a = current_a(float(state[0]))
        through_a = float(state[0]) / parallel_ohm(passing_a)
        return np.array([(passing_a - through_a) / CAPACITANCE_F * 1e-6, passing_a * 1e6])

    return float(_solved(change, 2, width_us)(width_us)[1]) / width_us


def commanded_ua(skin_ua: float, width_us: float, returns: int) -> float:
    """What the source is told for so much to pass."""

    def lacking(told: float) -> float:
        return passed_ua(told, width_us, returns) - skin_ua

    return float(brentq(lacking, skin_ua, 20.0 * skin_ua, rtol=1e-6))


def _solved(
    change: Callable[[float, Floats], Floats], size: int, until_us: float
) -> Callable[[float], Floats]:
    answer = solve_ivp(
        change,
        (0.0, until_us),
        np.zeros(size),
        method="LSODA",
        rtol=_TOLERANCE,
        atol=1e-12,
        dense_output=True,
    )
    assert answer.success, answer.message
    return lambda t_us: np.asarray(answer.sol(t_us))


def _height(reached_mv: Callable[[float], float]) -> float:
    """Where the membrane reaches V_th: the condition of equation 15, solved."""
    return float(brentq(lambda height: reached_mv(height) - THRESHOLD_MV, 1e-3, 1e9, rtol=1e-10))
