"""The part of the requested current for a contact that touches again, until it has settled.

Owns: the lowest recent resistance of each contact, when a contact has settled, and the part.
Must not know: how contact is detected, the soft start of a touch, limits.

A finger that touches again first lies on with a part of its area; the same current through a
smaller area is felt more strongly (Kajimoto, Electro-tactile Display, sections 3.1 and 4). The
resistance is inversely proportional to the area. No rule is published; this one is by design:

    part = (R_firm / R)^k, times 0.8 for the first 3 s, rising to 1 within 4 s more

with k of the person's own thresholds, R^-k, until R has fallen to R_firm. R_firm is the lowest
recent resistance of firm contact, confirmed by two pulses in a row; at first the calibration's. It
rises toward the present resistance with a time constant of 20 s, so that a finger that stays
lighter gets its full strength in the end. The part is at least 0.4, which is enough to measure by.
It falls at once and rises slowly, to avoid a step. Bounds and times were tuned on modelled fingers.

The part depends on time only where the person's thresholds were not found to fall as resistance
rises: no k in the calibration that may be used (on modelled fingers whose threshold does not follow
it, the part by resistance made the sensation less steady), or one that is not above zero (a larger
resistance is then felt less, as where ducts carry the current); and where a law by resistance
follows in the order, which compensates for the area itself. Without a calibration the part is 1, so
that a calibration presents what it requests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from etd.pulse.measured import BEND_UA, MAX_AGE_NS
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.slew import SlewLimiter

#: For how long a touch is new, and after how long the part by time is 1.
NEW_NS, SETTLED_NS = 3_000_000_000, 7_000_000_000
NEW_PART, LEAST_PART = 0.8, 0.4
_FORGOTTEN_NS = 20_000_000_000
_RISE_PER_S = 0.5


@dataclass(slots=True)
class _SettlingContact:
    """Logarithms of the resistance, extrapolated to no current."""

    firm_log_ohm: float
    last_log_ohm: float = math.inf
    then_ns: int = 0
    #: None: it has settled.
    touched_ns: int | None = None

    def remember(self, log_ohm: float, now_ns: int) -> None:
        """The lowest recent resistance: down when two pulses agree (one may err), up slowly."""
        confirmed = max(log_ohm, self.last_log_ohm)
        self.last_log_ohm = log_ohm
        elapsed_ns = min(max(0, now_ns - self.then_ns), MAX_AGE_NS)
        self.then_ns = now_ns
        if confirmed <= self.firm_log_ohm:
            self.firm_log_ohm = confirmed
        elif log_ohm > self.firm_log_ohm:
            rise = log_ohm - self.firm_log_ohm
            self.firm_log_ohm -= rise * math.expm1(-elapsed_ns / _FORGOTTEN_NS)


class Settling:
    """`goes_by_resistance`: False if another law by resistance follows."""

    def __init__(self, *, goes_by_resistance: bool) -> None:
        self._goes_by_resistance = goes_by_resistance
        self._contacts: dict[int, _SettlingContact] = {}
        self._part = SlewLimiter(1.0, _RISE_PER_S)

    def reset(self) -> None:
        self._contacts.clear()
        self._part.reset()

    def part(self, estimate: ElectrodeEstimate) -> float:
        """0.4..1 of the request; 1 where the contact has settled, or without a calibration."""
        if not estimate.reference_ohm or estimate.reference_at_ua is None:
            return 1.0
        contact = self._contacts.get(estimate.electrode)
        if contact is None:
            firm_log_ohm = _at_no_current(estimate.reference_ohm, estimate.reference_at_ua)
            contact = self._contacts[estimate.electrode] = _SettlingContact(firm_log_ohm)
        if estimate.state in ("open", "unknown") or estimate.firmness == 0.0:
            contact.touched_ns = estimate.now_ns
        log_ohm = _log_ohm(estimate)
        k = estimate.exponent if self._goes_by_resistance else None
        fallen = 0.0
        if log_ohm is not None and k is not None and k > 0.0:
            fallen = k * max(0.0, log_ohm - contact.firm_log_ohm)
        wanted = self._wanted(contact, fallen, estimate.now_ns)
        if estimate.state == "closed" and log_ohm is not None:
            contact.remember(log_ohm, estimate.now_ns)
        return self._part.toward(estimate.electrode, wanted, estimate.now_ns)

    def _wanted(self, contact: _SettlingContact, fallen: float, now_ns: int) -> float:
        """`fallen`: by how much the logarithm of the threshold lies below that of firm contact."""
        if contact.touched_ns is None:
            return 1.0
        new_part = _new_part(now_ns - contact.touched_ns)
        if fallen <= 0.0 and new_part >= 1.0:
            contact.touched_ns = None
            return 1.0
        return max(LEAST_PART, new_part * math.exp(-fallen))


def _new_part(since_ns: int) -> float:
    """The part by the time since the touch."""
    risen = (since_ns - NEW_NS) / (SETTLED_NS - NEW_NS)
    return NEW_PART + (1.0 - NEW_PART) * min(max(0.0, risen), 1.0)


def _log_ohm(estimate: ElectrodeEstimate) -> float | None:
    """Measured like the reference: at the beginning of pulses if the reference was."""
    ohm = estimate.higher_early_ohm() if estimate.is_reference_early else estimate.higher_ohm()
    if ohm is None or estimate.state not in ("soft", "closed"):
        return None
    return _at_no_current(ohm, estimate.skin_at_ua)


def _at_no_current(ohm: float, at_ua: int) -> float:
    """The resistance of skin falls with the current, see `reference`."""
    return math.log(ohm * (at_ua + BEND_UA) / BEND_UA)
