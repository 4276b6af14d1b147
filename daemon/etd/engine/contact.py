"""Which electrodes are touched, as far as pulses have told.

Owns: contact by threshold with hysteresis, and the resistance with the leak taken out.
Must not know: what follows from it, clocks, hardware beyond its constants.

With nothing connected the node rises to I x leak, or to the compliance: the open-circuit
signature. A touched electrode holds it well below. Both thresholds are fractions of that
signature, from the body-site file. An electrode that no pulse has visited is unknown.
"""

from __future__ import annotations

from etd.bodysite import SiteContact
from etd_hal.boardfile import Source


class ContactMap:
    """Contact, resistance and voltage of every electrode; None where unknown."""

    def __init__(self, electrodes: int, source: Source, site: SiteContact) -> None:
        self._leak_ohm = source.leak_ohm
        self._compliance_v = source.compliance_v
        self._touch_fraction = site.touch_fraction
        self._open_fraction = site.open_fraction
        self.is_touched: list[bool | None] = [None] * electrodes
        self.resistance_ohm: list[int | None] = [None] * electrodes
        self.voltage_v: list[float | None] = [None] * electrodes

    def forget(self) -> None:
        """The supply was off: whoever touched may have gone."""
        electrodes = len(self.is_touched)
        self.is_touched[:] = [None] * electrodes
        self.resistance_ohm[:] = [None] * electrodes
        self.voltage_v[:] = [None] * electrodes

    def learn(self, electrode: int, told_ua: int, voltage_v: float) -> bool:
        """What one pulse of `told_ua` says, given the node's voltage near its end.

        Returns True when an electrode known to be open is touched again.
        """
        if told_ua <= 0:
            return False
        signature_v = min(told_ua * self._leak_ohm / 1e6, self._compliance_v)
        self.voltage_v[electrode] = round(voltage_v, 2)
        self.resistance_ohm[electrode] = self._resistance(told_ua, voltage_v)
        was = self.is_touched[electrode]
        fraction = voltage_v / signature_v
        if fraction < self._touch_fraction:
            now = True
        elif fraction > self._open_fraction or was is None:
            now = False
        else:
            now = was
        self.is_touched[electrode] = now
        return now and was is False

    def _resistance(self, told_ua: int, voltage_v: float) -> int | None:
        """V / (I - V / leak); undefined near the compliance and where the leak takes it all."""
        through_ua = told_ua - voltage_v / self._leak_ohm * 1e6
        if through_ua < told_ua * 0.02 or voltage_v >= 0.95 * self._compliance_v:
            return None
        return int(voltage_v / through_ua * 1e6)
