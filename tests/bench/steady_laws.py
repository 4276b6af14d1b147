"""The stabilizers that the benchmark compares.

Owns: which there are, and their figures. Must not know: fingers, engines, what comes out.

`fitted` and `lines` have what `steady_fit.py` finds on fingers that the benchmark leaves out,
rounded, and within the laws' own bounds. `pressure` has its full strength at the pressure that the
finger lies with on average: who lies lighter gets less.
"""

from __future__ import annotations

from etd.stabilize.bursts import Bursts
from etd.stabilize.contact import ContactLaw
from etd.stabilize.energy import EnergyLaw
from etd.stabilize.fitted import FittedLaw
from etd.stabilize.lines import LinesLaw
from etd.stabilize.narrow import Narrow
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.pressure import PressureLaw
from etd.stabilize.settings import NOTHING, Settings
from etd_body.course import BUSY

NONE, CONTACT = "none", "contact"
#: Those that follow resistance by what was fitted to a person, with contact before them.
CALIBRATED = "contact + fitted"
#: The same, looking ahead before every pulse.
AHEAD = "contact + fitted + probe"
CONTACT_AHEAD = "contact + probe"

_CONTACT = ContactLaw()
_FITTED = FittedLaw(k=1.05)
_LINES = LinesLaw(charge_slope=-0.48, energy_slope=0.22)

LAWS: dict[str, Settings] = {
    NONE: NOTHING,
    CONTACT: Settings(order=("contact",), contact=_CONTACT),
    "pressure": Settings(
        order=("pressure",), pressure=PressureLaw(full_kpa=BUSY.mean_pressure_kpa)
    ),
    "energy": Settings(order=("energy",), energy=EnergyLaw()),
    "fitted": Settings(order=("fitted",), fitted=_FITTED),
    "lines": Settings(order=("lines",), lines=_LINES),
    CALIBRATED: Settings(order=("contact", "fitted"), contact=_CONTACT, fitted=_FITTED),
    CONTACT_AHEAD: Settings(order=("contact",), contact=_CONTACT, probe_first=True),
    AHEAD: Settings(
        order=("contact", "fitted"), contact=_CONTACT, fitted=_FITTED, probe_first=True
    ),
    "narrow": Settings(order=("narrow",), narrow=Narrow(width_us=50, tau_us=151.0)),
    "prepulse": Settings(order=("prepulse",), prepulse=Prepulse(below_db=6.0, width_us=20)),
    "bursts": Settings(bursts=Bursts(pulses=2, rate_hz=350.0)),
}
