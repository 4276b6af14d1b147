"""How strong and how long: strength-duration, the width of least energy, the nerve's thickness.

Owns: three figures of Kajimoto, Electro-tactile Display, section 2.2, with their closed forms.
Must not know: drawing, the terminal.
"""

from __future__ import annotations

from math import exp, log

import numpy as np

from etd.explain.figure import Axis, Check, Curve, Figure, floats
from etd_body.membrane import (
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

#: The thick fibre; its figures are [design].
DIAMETER_UM = 10.0
_WIDTHS_US = np.geomspace(20.0, 2_000.0, 60)
_CHECKED_WIDTHS_US = (20.0, 50.0, 100.0, 200.0, 1_000.0)
_FOR_EVER_US = 1e6


def strength_duration() -> Figure:
    """Section 2.2, Figure 7; equations 16 and 17."""
    curves = [_relative_curve(kind, way, name) for kind, way, name in _FIBRES]
    nerve = _threshold_mv(DIAMETER_UM, _FOR_EVER_US)
    simple = [_threshold_mv(DIAMETER_UM, one) / nerve for one in _WIDTHS_US]
    curves.append(Curve("one node (eq. 16)", floats(_WIDTHS_US), floats(simple), dashed=True))
    return Figure(
        "strength-duration",
        "The shorter the pulse, the higher it must be",
        "Threshold over its own rheobase. For short pulses it goes with 1/width, charge being what"
        " counts; for long ones it stops at the rheobase. Fibres under the fake's electrodes need"
        " more than one node alone does, and thin ones most.",
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
    rate = _rate(DIAMETER_UM)
    rheobase = _threshold_mv(DIAMETER_UM, _FOR_EVER_US)
    chronaxie_us = log(2.0) / rate

    def by_nerve(width_us: float) -> float:
        return _threshold_mv(DIAMETER_UM, width_us) ** 2 * width_us

    def hyperbola(width_us: float) -> float:
        return rheobase * (1.0 + chronaxie_us / width_us)

    def by_hyperbola(width_us: float) -> float:
        return hyperbola(width_us) ** 2 * width_us

    best_us, best_hyperbola_us = (minimum(one, 1.0, 5_000.0) for one in (by_nerve, by_hyperbola))
    least, least_hyperbola = by_nerve(best_us), by_hyperbola(best_hyperbola_us)
    u = optimum_by_formula()
    widths = floats(_WIDTHS_US)
    return Figure(
        "optimal-width",
        "The pulse of least energy",
        "Energy of a pulse that is just felt, over the least there is. The exponential nerve has"
        " its optimum at 1.4 times the rheobase, the hyperbola at twice the rheobase; the width"
        " there is the chronaxie of the hyperbola. Displays use shorter ones: pain counts more.",
        Axis("pulse width (us)", "log"),
        Axis("energy / least energy", "linear", most=4.0),
        (
            Curve("exponential (eq. 18)", widths, tuple(by_nerve(w) / least for w in widths)),
            Curve(
                "hyperbola (eq. 20)",
                widths,
                tuple(by_hyperbola(w) / least_hyperbola for w in widths),
            ),
        ),
        (
            Check("width of least energy, us", best_us, u / rate, "eq. 18: exp(aT) = 1 + 2aT"),
            Check(
                "height there / rheobase",
                _threshold_mv(DIAMETER_UM, best_us) / rheobase,
                1.0 / (1.0 - exp(-u)),
                "eq. 18: 1.4",
            ),
            Check("hyperbola's width, us", best_hyperbola_us, chronaxie_us, "eq. 21: T = d/c"),
            Check(
                "hyperbola's height / rheobase",
                hyperbola(best_hyperbola_us) / rheobase,
                2.0,
                "eq. 21: 2c",
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
        "Thick fibres before thin ones, and with narrow pulses the more so",
        f"Threshold over that of a fibre of {DIAMETER_UM:g} um. Pain comes by thin fibres: a narrow"
        " pulse leaves more room between what is felt and what hurts.",
        Axis("diameter (um)", "log"),
        Axis(f"threshold / that of {DIAMETER_UM:g} um", "log"),
        tuple(
            Curve(
                f"{width_us:g} us" if width_us < _FOR_EVER_US else "for ever",
                floats(diameters),
                tuple(over_thick(float(one), width_us) for one in diameters),
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


_FIBRES: tuple[tuple[FibreKind, float, str], ...] = (
    (TOUCH_VERTICAL, 1.0, "touch, anodic"),
    (TOUCH_PARALLEL, -1.0, "touch, cathodic"),
    (PAIN_VERTICAL, 1.0, "pain, anodic"),
)


def _relative_curve(kind: FibreKind, way: float, name: str) -> Curve:
    """A fibre of the fake's body under an electrode, its returns far away."""
    membrane = kind.membrane()
    drive = way * disk_potential(kind.line_mm(), NOMINAL_RADIUS_MM) @ kind.drive_per_mv()
    most = float(membrane.final(drive).max())
    relative = [most / float(membrane.step_response(drive, one).max()) for one in _WIDTHS_US]
    return Curve(name, floats(_WIDTHS_US), floats(relative))
