"""Contact: what a lost, new or overstrained contact gets.

Owns: the law below. Must not know: how contact is told from none (`sensing/contact.py`), limits.

An electrode that peels gives the whole current to the skin that is left, which is felt as a shock
or an itch (Kajimoto, Electro-tactile Display, section 4); a new contact begins small and gets the
whole programmed current at once. No rule for it is described in print; this one is by design:

    open        a probe: `start` of the threshold, so that the next contact is noticed
    soft        I = start + (wanted - start) x firmness, firmness 0..1 over the site's `soften_ms`,
                with start = `start_fraction` of the threshold, or of the wanted current where no
                calibration says it
    saturated   `back_off` of what could not be delivered, and from there up again slowly, to
                what the known resistance lets through at 0.9 of the compliance, and no further
    shorted     the same as soft at firmness 0: the current goes to a neighbor
    unknown     the same: after a pause the contact is not known, until this pulse measures it
    closed      what is wanted

Soft begins at a contact after none or after a pause, and at a resistance that rose by half from one
pulse to the next (peeling). What is wanted of it is then only a part, as long as `settling` has it
that the contact is not yet what it was. It never asks for more than was wanted.
"""

from __future__ import annotations

from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.law_settings import ContactSettings
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.settling import Settling
from etd.stabilize.slew import SlewLimiter

#: Of the compliance: what a pulse may need by the resistance known.
_LIFTED = 0.9


class Contact:
    def __init__(
        self, law: ContactSettings, leak_ohm: float, compliance_v: float, *, is_alone: bool
    ) -> None:
        """`is_alone`: no law by resistance follows."""
        self._law = law
        self.max_gain = MaxGain()
        self._leak_s = 1.0 / leak_ohm
        self._liftable_ua = _LIFTED * compliance_v * 1e6
        self._deliverable = SlewLimiter(1.0, law.rise_per_s)
        self._settling = Settling(goes_by_resistance=is_alone)

    def reset(self) -> None:
        self._deliverable.reset()
        self._settling.reset()

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        if request.current_ua <= 0:
            return request
        settled_ua = int(request.current_ua * self._settling.part(estimate))
        current_ua = self._softened(settled_ua, estimate)
        current_ua = min(current_ua, self._deliverable_ua(request.current_ua, estimate))
        if current_ua == request.current_ua:
            return request
        return request.stepped(current_ua, request.width_us)

    def _softened(self, wanted_ua: int, estimate: ElectrodeEstimate) -> int:
        if estimate.state in ("closed", "saturated"):
            return wanted_ua
        firmness = estimate.firmness if estimate.state == "soft" else 0.0
        felt_ua = wanted_ua if estimate.threshold_ua is None else estimate.threshold_ua
        start_ua = min(wanted_ua, int(self._law.start_fraction * felt_ua))
        return start_ua + int((wanted_ua - start_ua) * firmness)

    def _deliverable_ua(self, wanted_ua: int, estimate: ElectrodeEstimate) -> int:
        wanted = 1.0
        if estimate.undelivered_ua is not None:
            wanted = min(1.0, self._law.back_off * estimate.undelivered_ua / wanted_ua)
        elif (ohm := estimate.higher_ohm()) is not None:
            wanted = min(1.0, self._liftable_ua * (1.0 / ohm + self._leak_s) / wanted_ua)
        return int(
            wanted_ua * self._deliverable.toward(estimate.electrode, wanted, estimate.now_ns)
        )
