"""How strong and how long: strength-duration, the width of least energy, the nerve's thickness.

Owns: three figures of Kajimoto, Electro-tactile Display, section 2.2, with their closed forms.
Must not know: drawing, the terminal.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, log

import numpy as np

from etd.explain.figure import Axis, Check, Curve, Figure, floats
from etd_body.membrane import (
    Membrane,
    NerveConstants,
    least_height,
    minimum,
    simplified,
    simplified_response,
)
from etd_body.nerve import (
    NOMINAL_RADIUS_MM,
    PAIN_VERTICAL,
    THRESHOLD_MV,
    TOUCH_PARALLEL,
    TOUCH_VERTICAL,
    FibreKind,
    disk_potential,
)
from etd_body.tissue import Floats

#: The thick fibre; its figures are [design].
DIAMETER_UM = 10.0
_WIDTHS_US = np.geomspace(20.0, 2_000.0, 60)
_CHECKED_WIDTHS_US = (20.0, 50.0, 100.0, 200.0, 1_000.0)
_FOR_EVER_US = 1e6
#: So many make a hyperbola, from 20 us on, to 3 parts in a million.
_SPREAD_OVER = 48


def strength_duration() -> Figure:
    """Section 2.2, Figure 7; equations 16 and 17."""
    curves = [_relative_curve(kind, way, name) for kind, way, name in _FIBRES]
    nerve = _threshold_mv(DIAMETER_UM, _FOR_EVER_US)
    simple = [_threshold_mv(DIAMETER_UM, width_us) / nerve for width_us in _WIDTHS_US]
    curves.append(Curve("one node (eq. 16)", floats(_WIDTHS_US), floats(simple), dashed=True))
    return Figure(
        "strength-duration",
        "Shorter pulses need more current",
        "Threshold divided by the rheobase. For short pulses it is proportional to 1/width (equal"
        " charge); for long pulses it approaches the rheobase. Fibres under the fake's electrodes"
        " need more than a single node does, thin ones most.",
        Axis("pulse width (us)", "log"),
        Axis("threshold / rheobase", "log"),
        tuple(curves),
        (
            *(
                Check(
                    f"threshold at {width_us:g} us, mV",
                    _threshold_mv(DIAMETER_UM, width_us),
                    threshold_by_formula(DIAMETER_UM, width_us),
                    "eq. 16",
                )
                for width_us in _CHECKED_WIDTHS_US
            ),
            Check("rheobase, mV", nerve, rheobase_by_formula(DIAMETER_UM), "eq. 17"),
        ),
    )


def optimal_width() -> Figure:
    """Section 2.2.2; equations 18 to 21."""
    spread = spread_rates(chronaxie_by_formula(DIAMETER_UM), DIAMETER_UM)
    nerve = _Energy(lambda width_us: _threshold_mv(DIAMETER_UM, width_us))
    hyperbola = _Energy(lambda width_us: _threshold_of_sum_mv(*spread, width_us))
    touch = _Energy(lambda width_us: _fibre_threshold_ua(TOUCH_VERTICAL, 1.0, width_us))
    u = optimum_by_formula()
    return Figure(
        "optimal-width",
        "The pulse of least energy",
        "Energy of a pulse at threshold, divided by its minimum. The exponential nerve has its"
        " optimum at 1.4 times the rheobase, the hyperbola at twice the rheobase, where the width"
        " is its chronaxie. A nerve with one time constant is not a hyperbola; a membrane with"
        " exponentially distributed rates is, and is used here. The fake's touch fibre lies"
        f" between: {touch.best_height:.2f} times, at {touch.best_us:.0f} us. Displays use shorter"
        " pulses, to avoid pain.",
        Axis("pulse width (us)", "log"),
        Axis("energy / least energy", "linear", most=4.0),
        (
            nerve.curve("exponential (eq. 18)"),
            hyperbola.curve("hyperbola (eq. 20)"),
            touch.curve("touch, anodic"),
        ),
        (
            Check(
                "nerve of one node: width of least energy, us",
                nerve.best_us,
                u / _rate(DIAMETER_UM),
                "eq. 18: exp(aT) = 1 + 2aT",
            ),
            Check(
                "height there / rheobase", nerve.best_height, 1.0 / (1.0 - exp(-u)), "eq. 18: 1.4"
            ),
            Check(
                "where it needs twice its rheobase, us",
                nerve.chronaxie_us(),
                chronaxie_by_formula(DIAMETER_UM),
                "eq. 16 = 2 x eq. 17: ln 2 / a",
            ),
            Check(
                "spread rates: width of least energy, us",
                hyperbola.best_us,
                chronaxie_by_formula(DIAMETER_UM),
                "eq. 21: T = d/c",
            ),
            Check("height there / their rheobase", hyperbola.best_height, 2.0, "eq. 21: 2c"),
            Check(
                "touch, anodic: energy at its fitted d/c / least",
                touch.at_fitted_hyperbola(),
                1.0,
                "eq. 21, d and c fitted to its charges",
            ),
        ),
    )


def thickness() -> Figure:
    """Section 2.2.1."""
    diameters = np.geomspace(0.5, 20.0, 40)

    def over_thick(diameter_um: float, width_us: float) -> float:
        return _threshold_mv(diameter_um, width_us) / _threshold_mv(DIAMETER_UM, width_us)

    def over_thick_by_formula(diameter_um: float, width_us: float) -> float:
        thick = threshold_by_formula(DIAMETER_UM, width_us)
        return threshold_by_formula(diameter_um, width_us) / thick

    return Figure(
        "thickness",
        "Thick fibres are excited before thin ones, most clearly by narrow pulses",
        f"Threshold divided by that of a fibre of {DIAMETER_UM:g} um. Pain is carried by thin"
        " fibres: with narrow pulses the thresholds of touch and pain are further apart.",
        Axis("diameter (um)", "log"),
        Axis(f"threshold / that of {DIAMETER_UM:g} um", "log"),
        tuple(
            Curve(
                f"{width_us:g} us" if width_us < _FOR_EVER_US else "for ever",
                floats(diameters),
                tuple(over_thick(float(diameter), width_us) for diameter in diameters),
            )
            for width_us in (20.0, 100.0, 400.0, _FOR_EVER_US)
        ),
        tuple(
            Check(
                f"{diameter_um:g} um over {DIAMETER_UM:g} um at {width_us:g} us",
                over_thick(diameter_um, width_us),
                over_thick_by_formula(diameter_um, width_us),
                "eq. 16, G_a ~ d2, C_m and G_m ~ d",
            )
            for diameter_um in (1.0, 2.5)
            for width_us in (20.0, 100.0, 400.0)
        ),
    )


# --- the closed forms --------------------------------------------------------------------------


def threshold_by_formula(diameter_um: float, width_us: float) -> float:
    """Equation 16, in mV."""
    return rheobase_by_formula(diameter_um) / (1.0 - exp(-_rate(diameter_um) * width_us))


def rheobase_by_formula(diameter_um: float) -> float:
    """Equation 17, in mV: V_th / b."""
    nerve = NerveConstants.of_diameter(diameter_um)
    return THRESHOLD_MV * (nerve.inside_us + nerve.membrane_us) / nerve.inside_us


def chronaxie_by_formula(diameter_um: float) -> float:
    """In us: the width at which equation 16 is twice equation 17."""
    return log(2.0) / _rate(diameter_um)


def optimum_by_formula() -> float:
    """The root aT of exp(aT) = 1 + 2aT, where equation 18's derivative vanishes."""
    u = 1.0
    for _ in range(100):
        u = log(1.0 + 2.0 * u)
    return u


def _rate(diameter_um: float) -> float:
    """a, in 1/us."""
    nerve = NerveConstants.of_diameter(diameter_um)
    return (nerve.inside_us + nerve.membrane_us) / nerve.capacitance_pf


# --- the model ---------------------------------------------------------------------------------


def _threshold_mv(diameter_um: float, width_us: float) -> float:
    """Of the nerve of Figure 5, by the membrane's equations."""
    nerve = NerveConstants.of_diameter(diameter_um)
    if width_us >= _FOR_EVER_US:
        final = simplified(nerve).final(np.array([nerve.inside_us]))
        return least_height(float(final[0]), THRESHOLD_MV)
    return least_height(simplified_response(nerve, 1.0, width_us), THRESHOLD_MV)


class _Energy:
    """Of a pulse at the threshold that a model has at each width, which is a current or a voltage.

    Equations 18 and 20: the square of its height, times its width.
    """

    def __init__(self, threshold: Callable[[float], float]) -> None:
        self._threshold = threshold
        self._rheobase = threshold(_FOR_EVER_US)
        self.best_us = minimum(self._energy, 1.0, 5_000.0)
        #: Over the rheobase.
        self.best_height = threshold(self.best_us) / self._rheobase

    def _energy(self, width_us: float) -> float:
        return self._threshold(width_us) ** 2 * width_us

    def chronaxie_us(self) -> float:
        """Where twice the rheobase is needed: the threshold falls with the width."""
        short_us, long_us = 1.0, 5_000.0
        while long_us - short_us > 1e-6 * long_us:
            middle_us = (short_us + long_us) / 2.0
            if self._threshold(middle_us) > 2.0 * self._rheobase:
                short_us = middle_us
            else:
                long_us = middle_us
        return long_us

    def at_fitted_hyperbola(self) -> float:
        """Energy divided by its minimum, at the width given by equation 21: equation 19 times T is
        a straight line, fitted to the threshold charges at all widths shown.
        """
        charges = [self._threshold(float(width_us)) * float(width_us) for width_us in _WIDTHS_US]
        c, d = np.polyfit(_WIDTHS_US, charges, 1)
        return self._energy(float(d / c)) / self._energy(self.best_us)

    def curve(self, name: str) -> Curve:
        least = self._energy(self.best_us)
        relative = [self._energy(float(width_us)) / least for width_us in _WIDTHS_US]
        return Curve(name, floats(_WIDTHS_US), floats(relative))


def spread_rates(chronaxie_us: float, diameter_um: float) -> tuple[Membrane, Floats]:
    """Independent nodes with exponentially distributed rates, and their drive by a unit current.

    The mean of 1 - exp(-sT) over rates s of density d exp(-s d) is T / (T + d): the response of
    equation 19's hyperbola, whose chronaxie is d. The mean is computed by Gauss-Laguerre
    quadrature; the sum has equation 17's rheobase.
    """
    rates, weights = np.polynomial.laguerre.laggauss(_SPREAD_OVER)
    conductance_us = rates / chronaxie_us
    membrane = Membrane(np.diag(conductance_us), np.ones(_SPREAD_OVER))
    share = THRESHOLD_MV / rheobase_by_formula(diameter_um)
    return membrane, np.asarray(share * weights * conductance_us)


def _threshold_of_sum_mv(membrane: Membrane, drive: Floats, width_us: float) -> float:
    """Where what is counted is all nodes together."""
    return least_height(float(_response(membrane, drive, width_us).sum()), THRESHOLD_MV)


def _fibre_threshold_ua(kind: FibreKind, way: float, width_us: float) -> float:
    """Of a fibre of the fake's body under an electrode, its returns far away."""
    membrane, drive = _under_an_electrode(kind, way)
    return least_height(float(_response(membrane, drive, width_us).max()), THRESHOLD_MV)


def _under_an_electrode(kind: FibreKind, way: float) -> tuple[Membrane, Floats]:
    """It, and what 1 uA drives it with."""
    potential = disk_potential(kind.line_mm(), NOMINAL_RADIUS_MM)
    return kind.membrane(), np.asarray(way * potential @ kind.drive_per_mv())


def _response(membrane: Membrane, drive: Floats, width_us: float) -> Floats:
    if width_us >= _FOR_EVER_US:
        return membrane.final(drive)
    return membrane.step_response(drive, width_us)


_FIBRES: tuple[tuple[FibreKind, float, str], ...] = (
    (TOUCH_VERTICAL, 1.0, "touch, anodic"),
    (TOUCH_PARALLEL, -1.0, "touch, cathodic"),
    (PAIN_VERTICAL, 1.0, "pain, anodic"),
)


def _relative_curve(kind: FibreKind, way: float, name: str) -> Curve:
    membrane, drive = _under_an_electrode(kind, way)
    most = float(membrane.final(drive).max())
    relative = [
        most / float(membrane.step_response(drive, width_us).max()) for width_us in _WIDTHS_US
    ]
    return Curve(name, floats(_WIDTHS_US), floats(relative))
