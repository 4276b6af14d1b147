"""The stabilizers that the benchmark compares.

Owns: which there are, and their figures. Must not know: fingers, engines, what comes out.

`fitted` and `lines` have what `steady_fit.py` finds on fingers that the benchmark leaves out,
rounded, and within the laws' own bounds. `pressure` has its full strength at the pressure that the
finger lies with on average: who lies lighter gets less.
"""

from __future__ import annotations

from etd.files.body_site import load_body_site
from etd.files.resources import find, names
from etd.stabilize.bursts import Bursts
from etd.stabilize.law_settings import (
    ContactSettings,
    EnergySettings,
    LinearLawSettings,
    PowerLawSettings,
    PressureSettings,
)
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd.stabilize.strength_duration import StrengthDuration
from etd_body.course import BUSY

NONE, CONTACT = "none", "contact"
#: Those that follow resistance by what was fitted to a person, with contact before them.
CALIBRATED = "contact + power_law"
#: The same, looking ahead before every pulse.
AHEAD = "contact + power_law + probe"
CONTACT_AHEAD = "contact + probe"
#: The same laws by the k that the fit procedure finds on the very finger (`steady_fit_own.py`).
OWN, OWN_PROBED = "power_law, own k", "power_law + probe, own k"
OWN_AHEAD = "contact + power_law + probe, own k"
OWN_K = (OWN, OWN_PROBED, OWN_AHEAD)
#: What docs/stabilization.md shows how to switch on.
ENERGY_AHEAD = "contact + energy + probe"

_CONTACT = ContactSettings()
#: Of modelled fingers that nothing else here is judged on.
K = 1.05
_FITTED = PowerLawSettings()
_LINES = LinearLawSettings(charge_slope=-0.48, energy_slope=0.22)

LAWS: dict[str, Settings] = {
    NONE: NO_STABILIZERS,
    CONTACT: Settings(order=("contact",), contact=_CONTACT),
    "pressure": Settings(
        order=("pressure",), pressure=PressureSettings(full_kpa=BUSY.mean_pressure_kpa)
    ),
    "energy": Settings(order=("energy",), energy=EnergySettings()),
    "power_law": Settings(order=("power_law",), power_law=_FITTED),
    "linear_law": Settings(order=("linear_law",), linear_law=_LINES),
    CALIBRATED: Settings(order=("contact", "power_law"), contact=_CONTACT, power_law=_FITTED),
    CONTACT_AHEAD: Settings(order=("contact",), contact=_CONTACT, probe_first=True),
    AHEAD: Settings(
        order=("contact", "power_law"), contact=_CONTACT, power_law=_FITTED, probe_first=True
    ),
    ENERGY_AHEAD: Settings(
        order=("contact", "energy"), contact=_CONTACT, energy=EnergySettings(), probe_first=True
    ),
    OWN: Settings(order=("power_law",), power_law=_FITTED),
    OWN_PROBED: Settings(order=("power_law",), power_law=_FITTED, probe_first=True),
    OWN_AHEAD: Settings(
        order=("contact", "power_law"), contact=_CONTACT, power_law=_FITTED, probe_first=True
    ),
    "strength_duration": Settings(
        order=("strength_duration",), strength_duration=StrengthDuration(width_us=50, tau_us=151.0)
    ),
    "prepulse": Settings(order=("prepulse",), prepulse=Prepulse(below_db=6.0, width_us=20)),
    "bursts": Settings(bursts=Bursts(pulses=2, rate_hz=350.0)),
}


def _shipped() -> dict[str, Settings]:
    """Of the body sites that ship with a law switched on, each by a name of its own."""
    sites = {site: load_body_site(find("bodysites", site)).stabilize for site in names("bodysites")}
    return {f"site {site}": sites[site] for site in sites if sites[site] != NO_STABILIZERS}


_SITES = _shipped()
LAWS |= _SITES
#: The names of those that ship.
SHIPPED = tuple(_SITES)
#: Those whose work is steadiness, in the order in which they are played on all bodies: what is
#: nearest to a recommendation first. The others serve the range.
FOR_STEADINESS = (NONE, *SHIPPED, *OWN_K, CONTACT, "energy", CONTACT_AHEAD, AHEAD, ENERGY_AHEAD)
#: Those that a few electrodes tell enough of.
FOR_SHORT = (*FOR_STEADINESS, "power_law", CALIBRATED, "linear_law", "pressure")
#: On the fake's own finger, where one k holds for all fingers.
FOR_FINGER = tuple(law for law in LAWS if law not in OWN_K)
